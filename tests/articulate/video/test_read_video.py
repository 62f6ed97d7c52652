"""Read videos, and reject files that are none."""

import os
import resource

import numpy as np
import pytest

from articulate.errors import UsageError
from articulate.render.joint_video import Video
from articulate.video import read_video as reader
from articulate.video.read_video import VideoError, VideoReadOptions, check_motion, read_video


def ramp(n_frames, step=4):
    frames = np.full((n_frames, 48, 64, 3), 200, dtype=np.uint8)
    for t in range(n_frames):
        frames[t, 10:30, 5 + step * t : 20 + step * t] = (20, 60, 120)
    return frames


def encode(path, frames, fps=20.0):
    return Video(frames=frames, times_s=np.arange(len(frames)) / fps).write(path)


def test_a_video_is_read_with_its_frames_and_times(tmp_path):
    frames = ramp(8)
    clip = read_video(encode(tmp_path / "a.mp4", frames))
    assert clip.frames.shape == frames.shape
    assert clip.fps == pytest.approx(20.0, rel=0.02)
    assert np.abs(clip.frames.astype(int) - frames).mean() < 6.0


def test_frames_are_subsampled_evenly_and_reduced(tmp_path):
    path = encode(tmp_path / "a.mp4", ramp(10))
    clip = read_video(path, VideoReadOptions(longest_side_px=32, most_frames=4))
    assert clip.frames.shape == (4, 24, 32, 3)
    assert np.allclose(clip.times_s * 20.0, [0, 3, 6, 9], atol=0.05)


def test_a_missing_video_is_rejected(tmp_path):
    with pytest.raises(VideoError, match="no such file"):
        read_video(tmp_path / "none.mp4")


def test_a_name_that_is_too_long_is_rejected(tmp_path):
    with pytest.raises(VideoError, match="too long"):
        read_video(tmp_path / ("x" * 300 + ".mp4"))


def test_an_empty_file_is_rejected(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"")
    with pytest.raises(VideoError, match="is empty"):
        read_video(tmp_path / "a.mp4")


def test_a_file_that_is_no_video_is_rejected(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"this is no video at all" * 100)
    with pytest.raises(VideoError, match=r"cannot be read as a video|no frame can be decoded"):
        read_video(tmp_path / "a.mp4")


@pytest.mark.parametrize(
    "text",
    [
        "a letter\nthat is called a video\n" * 200,
        "#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nreal.mp4\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile real.mp4\n",
    ],
    ids=["text", "playlist", "concat"],
)
def test_text_and_lists_of_other_files_are_no_videos(tmp_path, text):
    """The decoder renders the first letter by letter and opens the files that the others name."""
    encode(tmp_path / "real.mp4", ramp(8))
    (tmp_path / "list.txt").write_text(text)
    with pytest.raises(VideoError, match="cannot be read as a video"):
        read_video(tmp_path / "list.txt")


def test_a_playlist_is_reported_in_one_line(tmp_path, error_line):
    (tmp_path / "list.txt").write_text("#EXTM3U\n#EXTINF:4,\nreal.mp4\n")
    error_line("read_video(a playlist)", lambda: read_video(tmp_path / "list.txt"))


def test_only_kept_frames_of_a_long_video_are_held(tmp_path, monkeypatch, error_line):
    path = encode(tmp_path / "a.mp4", ramp(12))
    monkeypatch.setattr(reader, "MAX_BYTES", 3 * 48 * 64 * 3)
    assert read_video(path, VideoReadOptions(most_frames=3)).frames.shape == (3, 48, 64, 3)
    error_line(
        "read_video(a.mp4, four frames where three fit)",
        lambda: read_video(path, VideoReadOptions(most_frames=4)),
    )


def test_a_video_of_one_frame_is_rejected(tmp_path):
    with pytest.raises(VideoError, match="one frame"):
        read_video(encode(tmp_path / "a.mp4", ramp(1)))


def test_equal_frames_are_rejected():
    rng = np.random.default_rng(0)
    still = np.repeat(ramp(1), 6, axis=0)
    noisy = np.clip(still + rng.normal(0.0, 0.8, still.shape), 0, 255).astype(np.uint8)
    with pytest.raises(UsageError, match="nothing moves"):
        check_motion(noisy, "a.mp4")


def test_frames_with_a_moving_patch_are_accepted():
    check_motion(ramp(6), "a.mp4")


def test_a_text_that_starts_like_packets_is_no_video(tmp_path):
    for begin in ("G", "abcdG"):
        (tmp_path / "letter.txt").write_text(begin + "ood day\n" * 100)
        with pytest.raises(VideoError, match="cannot be read as a video"):
            read_video(tmp_path / "letter.txt")


@pytest.mark.parametrize("lead", [0, 4])
def test_a_transport_stream_is_known_by_the_sign_of_its_packets(tmp_path, monkeypatch, lead):
    opened: list[object] = []

    def length(path: object, deadline_s: float) -> tuple[int, float]:
        opened.append(path)
        return 0, 25.0

    monkeypatch.setattr(reader, "_length", length)
    packet = b"\x47" + bytes(187)
    (tmp_path / "a.ts").write_bytes((bytes(lead) + packet) * 4)
    with pytest.raises(VideoError, match="no frame"):
        read_video(tmp_path / "a.ts")
    assert opened


def test_a_video_that_is_too_long_is_rejected_and_not_cut(tmp_path, monkeypatch, error_line):
    path = encode(tmp_path / "a.mp4", ramp(12))
    monkeypatch.setattr(reader, "MAX_FRAMES", 12)
    assert len(read_video(path).frames) == 12
    monkeypatch.setattr(reader, "MAX_FRAMES", 11)
    error_line("read_video(a.mp4, 12 frames where 11 are read)", lambda: read_video(path))


def test_a_truncated_video_is_reported_without_decoder_output(tmp_path, capfd):
    path = encode(tmp_path / "a.mp4", ramp(12))
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(VideoError):
        read_video(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", ["device", "fifo", "folder"])
def test_files_that_are_not_regular_are_rejected(tmp_path, kind):
    path = tmp_path / "a.mp4"
    if kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.mkdir()
    with pytest.raises(VideoError, match=r"not a regular file|a folder"):
        read_video(path)


def test_frames_of_huge_dimensions_are_rejected_before_decoding(tmp_path):
    """A GIF header may announce 65535x65535 px; the decoder would allocate 17 GB."""
    header = b"GIF89a" + b"\xff\xff\xff\xff" + b"\x00\x00\x00"
    image = b"," + bytes(4) + b"\xff\xff\xff\xff" + b"\x00" + b"\x02\x02\x4c\x01\x00"
    (tmp_path / "a.gif").write_bytes(header + image * 3 + b";")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(VideoError):
        read_video(tmp_path / "a.gif")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_500_000  # [KiB]


def test_decoding_ends_at_its_time_limit(tmp_path, monkeypatch):
    path = encode(tmp_path / "a.mp4", ramp(8))
    monkeypatch.setattr(reader, "MAX_DECODE_S", 0.0)
    with pytest.raises(VideoError, match="processor time"):
        read_video(path)
