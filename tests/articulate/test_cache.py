import multiprocessing
import os
import sys
import time
from pathlib import Path

import pytest

from articulate import cache as caches
from articulate.cache import cache_folder, cache_in_use, clean, entries, limit_bytes, touch


def put(cache, name, size=100, *, age_s=0.0, kind="assets"):
    """An entry of ``size`` bytes that was used ``age_s`` ago."""
    path = cache / kind / name
    path.mkdir(parents=True)
    (path / "content").write_bytes(b"x" * size)
    then = time.time() - age_s
    os.utime(path, (then, then))
    return path


def test_cache_lies_where_the_platform_keeps_caches(monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache_folder() == Path("/somewhere/articulate")
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # the standard says: ignore it
    monkeypatch.setenv("HOME", "/home/me")
    on_mac = sys.platform == "darwin"
    assert cache_folder() == Path(
        "/home/me/Library/Caches/articulate" if on_mac else "/home/me/.cache/articulate"
    )


def test_the_longest_unused_go_first_until_the_rest_fits(tmp_path):
    for k in range(5):
        put(tmp_path, f"e{k}", 10_000, age_s=1000 - 100 * k)
    room = sum(e.bytes for e in entries(tmp_path)[-2:])
    touch(tmp_path / "assets" / "e0")
    done = clean(tmp_path, room)
    assert sorted(p.name for p in (tmp_path / "assets").iterdir()) == ["e0", "e4"]
    assert (done.removed, done.left, done.busy) == (3, 2, 0)
    assert done.left_bytes <= room
    assert not list(tmp_path.glob(".trash-*"))


def test_nothing_is_left_of_a_cache_that_is_cleaned_for_good(tmp_path):
    for kind in caches.KINDS:
        put(tmp_path, "e", kind=kind)
    put(tmp_path, "mine", kind="something_else")
    assert clean(tmp_path, 0).left == 0
    assert entries(tmp_path) == []
    assert (tmp_path / "something_else" / "mine" / "content").is_file()


def test_what_a_process_at_work_uses_stays(tmp_path):
    old, used = put(tmp_path, "old", age_s=100), put(tmp_path, "used", age_s=100)
    with cache_in_use(tmp_path):
        touch(used)
        made = put(tmp_path, "made")
        assert clean(tmp_path, 0).busy == 2
        assert not old.exists()
        assert used.exists()
        assert made.exists()
    assert clean(tmp_path, 0).removed == 2


def test_a_process_that_died_at_work_holds_nothing_back(tmp_path):
    def die():
        with cache_in_use(tmp_path):
            put(tmp_path, "made")
            os._exit(9)

    process = multiprocessing.get_context("fork").Process(target=die)
    process.start()
    process.join()
    assert process.exitcode == 9
    assert len(list((tmp_path / "users").iterdir())) == 1
    assert clean(tmp_path, 0).removed == 1
    assert not list((tmp_path / "users").iterdir())


def test_cleaning_beside_processes_at_work_takes_nothing_from_under_them(tmp_path):
    def work(number):
        for k in range(30):
            with cache_in_use(tmp_path):
                mine = tmp_path / "assets" / f"{number}-{k}"
                mine.mkdir(parents=True)
                (mine / "content").write_text("whole")
                found = [path for path in (tmp_path / "assets").iterdir() if path.exists()]
                for path in found[:5]:
                    if path.name.startswith(f"{number}-"):
                        touch(path)
                time.sleep(0.002)
                if (mine / "content").read_text() != "whole":
                    os._exit(1)
        os._exit(0)

    context = multiprocessing.get_context("fork")
    workers = [context.Process(target=work, args=(n,)) for n in range(3)]
    for worker in workers:
        worker.start()
    removed = 0
    while any(worker.is_alive() for worker in workers):
        removed += clean(tmp_path, 0).removed
    for worker in workers:
        worker.join()
    assert [worker.exitcode for worker in workers] == [0, 0, 0]
    assert removed + clean(tmp_path, 0).removed == 90


def test_the_limit_is_seen_to_after_work_now_and_then(tmp_path, monkeypatch):
    monkeypatch.setenv("ARTICULATE_CACHE_GB", "0.00003")
    put(tmp_path, "a", 40_000, age_s=100)
    with cache_in_use(tmp_path):
        pass
    assert entries(tmp_path) == []
    put(tmp_path, "b", 40_000, age_s=100)
    with cache_in_use(tmp_path):
        pass
    assert len(entries(tmp_path)) == 1  # it was looked at a moment ago
    os.utime(tmp_path / "size_checked", (0, 0))
    with cache_in_use(tmp_path):
        pass
    assert entries(tmp_path) == []


@pytest.mark.parametrize("text", ["much", "-1", "nan"])
def test_a_limit_that_is_no_size_is_refused(text, monkeypatch, error_line):
    monkeypatch.setenv("ARTICULATE_CACHE_GB", text)
    error_line(f"limit_bytes()  # ARTICULATE_CACHE_GB={text}", limit_bytes)


def test_a_cache_that_cannot_be_made_is_refused(tmp_path, error_line):
    (tmp_path / "file").write_text("")
    error_line(
        "cache_in_use(file/cache)", lambda: cache_in_use(tmp_path / "file" / "cache").__enter__()
    )
