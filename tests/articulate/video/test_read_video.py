"""Reading films, and refusing what is none."""

import numpy as np
import pytest

from articulate.errors import UsageError
from articulate.render.joint_video import Video, write_video
from articulate.video import read_video
from articulate.video.read_video import VideoError, VideoReadOptions, check_motion, read_video


def ramp(n_frames, step=4):
    frames = np.full((n_frames, 48, 64, 3), 200, dtype=np.uint8)
    for t in range(n_frames):
        frames[t, 10:30, 5 + step * t : 20 + step * t] = (20, 60, 120)
    return frames


def film(path, frames, fps=20.0):
    return write_video(path, Video(frames=frames, times_s=np.arange(len(frames)) / fps))


def test_a_film_comes_back_with_its_frames_and_times(tmp_path):
    frames = ramp(8)
    clip = read_video(film(tmp_path / "a.mp4", frames))
    assert clip.frames.shape == frames.shape
    assert clip.fps == pytest.approx(20.0, rel=0.02)
    assert np.abs(clip.frames.astype(int) - frames).mean() < 6.0


def test_frames_are_thinned_evenly_and_made_smaller(tmp_path):
    path = film(tmp_path / "a.mp4", ramp(10))
    clip = read_video(path, VideoReadOptions(longest_side_px=32, most_frames=4))
    assert clip.frames.shape == (4, 24, 32, 3)
    assert np.allclose(clip.times_s * 20.0, [0, 3, 6, 9], atol=0.05)


def test_a_missing_film_is_refused(tmp_path):
    with pytest.raises(VideoError, match="no such file"):
        read_video(tmp_path / "none.mp4")


def test_a_name_that_no_disk_takes_is_refused(tmp_path):
    with pytest.raises(VideoError, match="too long"):
        read_video(tmp_path / ("x" * 300 + ".mp4"))


def test_an_empty_file_is_refused(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"")
    with pytest.raises(VideoError, match="is empty"):
        read_video(tmp_path / "a.mp4")


def test_a_file_that_is_no_film_is_refused(tmp_path):
    (tmp_path / "a.mp4").write_bytes(b"this is no film at all" * 100)
    with pytest.raises(VideoError, match=r"cannot be read as a film|no frame can be read"):
        read_video(tmp_path / "a.mp4")


@pytest.mark.parametrize(
    "text",
    [
        "a letter\nthat somebody calls a film\n" * 200,
        "#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nreal.mp4\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile real.mp4\n",
    ],
    ids=["text", "playlist", "concat"],
)
def test_text_and_lists_of_other_files_are_no_films(tmp_path, text):
    """The decoder draws the one letter by letter and opens what the others name."""
    film(tmp_path / "real.mp4", ramp(8))
    (tmp_path / "list.txt").write_text(text)
    with pytest.raises(VideoError, match="cannot be read as a film"):
        read_video(tmp_path / "list.txt")


def test_a_playlist_is_told_in_one_line(tmp_path, error_line):
    (tmp_path / "list.txt").write_text("#EXTM3U\n#EXTINF:4,\nreal.mp4\n")
    error_line("read_clip(a playlist)", lambda: read_video(tmp_path / "list.txt"))


def test_of_a_long_film_no_more_is_held_than_is_kept(tmp_path, monkeypatch, error_line):
    path = film(tmp_path / "a.mp4", ramp(12))
    monkeypatch.setattr(read_video, "MOST_BYTES", 3 * 48 * 64 * 3)
    assert read_video(path, VideoReadOptions(most_frames=3)).frames.shape == (3, 48, 64, 3)
    error_line(
        "read_clip(a.mp4, four frames where three fit)",
        lambda: read_video(path, VideoReadOptions(most_frames=4)),
    )


def test_a_film_of_one_frame_is_refused(tmp_path):
    with pytest.raises(VideoError, match="one frame"):
        read_video(film(tmp_path / "a.mp4", ramp(1)))


def test_frames_that_are_alike_are_refused():
    rng = np.random.default_rng(0)
    still = np.repeat(ramp(1), 6, axis=0)
    noisy = np.clip(still + rng.normal(0.0, 0.8, still.shape), 0, 255).astype(np.uint8)
    with pytest.raises(UsageError, match="nothing moves"):
        check_motion(noisy, "a.mp4")


def test_frames_in_which_a_patch_moves_are_accepted():
    check_motion(ramp(6), "a.mp4")


def test_a_text_that_begins_as_packets_do_is_no_film(tmp_path):
    for begin in ("G", "abcdG"):
        (tmp_path / "letter.txt").write_text(begin + "ood day\n" * 100)
        with pytest.raises(VideoError, match="cannot be read as a film"):
            read_video(tmp_path / "letter.txt")


@pytest.mark.parametrize("lead", [0, 4])
def test_a_transport_stream_is_known_by_the_sign_of_its_packets(tmp_path, monkeypatch, lead):
    opened: list[object] = []

    def length(path: object) -> tuple[int, float]:
        opened.append(path)
        return 0, 25.0

    monkeypatch.setattr(read_video, "_length", length)
    packet = b"\x47" + bytes(187)
    (tmp_path / "a.ts").write_bytes((bytes(lead) + packet) * 4)
    with pytest.raises(VideoError, match="no frame"):
        read_video(tmp_path / "a.ts")
    assert opened


def test_a_film_that_is_too_long_is_refused_and_not_cut(tmp_path, monkeypatch, error_line):
    path = film(tmp_path / "a.mp4", ramp(12))
    monkeypatch.setattr(read_video, "LONGEST", 12)
    assert len(read_video(path).frames) == 12
    monkeypatch.setattr(read_video, "LONGEST", 11)
    error_line("read_clip(a.mp4, 12 frames where 11 are read)", lambda: read_video(path))


def test_a_film_that_breaks_off_is_told_in_our_words_alone(tmp_path, capfd):
    path = film(tmp_path / "a.mp4", ramp(12))
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(VideoError):
        read_video(path)
    assert capfd.readouterr() == ("", "")
