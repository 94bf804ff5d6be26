import base64
import itertools
import json
import re
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

import broadcl
from conftest import oracle, uniform

TYPES = {"boxes": "<u2", "overlaps": "<u2", "filters": "<u4", "ids": "<u4", "partners": "<u4", "curve": "<u4"}


def contents(page):
    """What a page shows, of lists as replay.js unpacks them."""
    data, = json.loads(re.search(r'id="recordings">(.*?)</script>', page.html)[1])
    n = data["objects"]
    widths = {"boxes": 6 * n, "overlaps": n, "filters": 4 * n, "ids": n, "partners": None, "curve": 3}
    for name, width in widths.items():
        numbers = np.frombuffer(zlib.decompress(base64.b64decode(data[name])), TYPES[name])
        data[name] = numbers if not width else np.cumsum(numbers.reshape(-1, width), axis=0, dtype=numbers.dtype)
    counts = np.minimum(data["overlaps"], data["most_partners"]).T
    of_boxes = [part.tolist() for part in np.split(data["partners"], np.cumsum(counts)[:-1])]
    data["partners"] = [of_boxes[i * data["frames"] + frame] for frame in range(data["frames"]) for i in range(n)]
    return data


def partners_of(pairs, n):
    return [sorted(pairs[pairs[:, 0] == i, 1].tolist() + pairs[pairs[:, 1] == i, 0].tolist()) for i in range(n)]


def steps(n=60, frames=7):
    random = np.random.default_rng(2)
    return uniform(n) + np.tile(random.normal(0, 0.3, (frames, n, 3)).cumsum(axis=0), 2).astype(np.float32)


def expect_pairs(data, frames):
    """That its counts, its curve and its partners are those of the pairs of each frame."""
    last = set()
    for number, pairs in enumerate(frames):
        now = set(map(tuple, pairs.tolist()))
        assert data["curve"][number].tolist() == [len(now), len(now - last), len(last - now)]
        last = now
    partners = [partners_of(frame, data["objects"]) for frame in frames]
    assert data["overlaps"].ravel().tolist() == [len(p) for p in itertools.chain(*partners)]
    assert data["partners"] == list(itertools.chain(*partners))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_counts_and_partners_are_those_of_the_oracle(dtype):
    frames = steps().astype(dtype)
    for given in (frames, list(frames), iter(frames), frames.reshape(7, 60, 2, 3)):
        expect_pairs(contents(broadcl.view(given)), [oracle(frame) for frame in frames])


def test_boxes_come_back():
    frames = steps()
    data = contents(broadcl.view(frames))
    low, high = np.array(data["low"]), np.array(data["high"])
    back = np.swapaxes(data["boxes"].reshape(7, 6, 60), 1, 2) / data["levels"] * np.tile(high - low, 2) + np.tile(low, 2)
    assert np.abs(back - frames).max() < (high - low).max() / data["levels"]


def test_filters_and_distances():
    boxes, world = uniform(80), np.arange(80) % 3
    data = contents(broadcl.view(boxes, world=world, group=2, distance=0.5))
    assert data["filters"].reshape(4, 80).tolist() == [[2] * 80, [2**32 - 1] * 80, [2**32 - 1] * 80, world.tolist()]
    near = oracle(boxes, reach=0.5)
    expect_pairs(data, [near[world[near[:, 0]] == world[near[:, 1]]]])


def test_boxes_in_other_forms():
    boxes = uniform(30).astype(np.float64)
    expected = broadcl.view(boxes).html
    assert broadcl.view((boxes[:, :3], boxes[:, 3:])).html == expected == broadcl.view(boxes.tolist()).html
    flat = boxes[:, [0, 1, 3, 4]]
    expect_pairs(contents(broadcl.view(flat)), [oracle(np.insert(flat, (2, 4), 0, axis=1))])
    for nothing in ([], np.empty((0, 6))):
        assert contents(broadcl.view(nothing))["all_objects"] == 0
    assert contents(broadcl.view(boxes[0]))["all_objects"] == 1


def test_planes_do_not_hide_the_rest():
    boxes = uniform(30)
    planes = [[-1e18, -1e18, -1e18, 1e18, 0, 1e18], [-np.inf, 0, 0, np.inf, 1, 1], broadcl.EMPTY]
    data = contents(broadcl.view(np.vstack([boxes, planes])))
    assert np.allclose(data["low"], boxes[:, :3].min(axis=0)) and np.allclose(data["high"], boxes[:, 3:].max(axis=0))


def test_one_far_away_is_shown_but_not_in_the_focus():
    boxes = np.vstack([uniform(60), [900, 0, 0, 901, 1, 1]])
    data = contents(broadcl.view(boxes))
    assert data["high"][0] == 901 and np.all(np.abs(data["focus"]) < 10)


@pytest.mark.parametrize("frames", [1, 40])
def test_of_many_boxes_a_sample_is_shown_whose_partners_are_among_all(frames):
    boxes = uniform(30_000)
    data = contents(broadcl.view(np.broadcast_to(boxes, (frames, 30_000, 6))))
    pairs = broadcl.overlapping_pairs(boxes)
    assert data["all_objects"] == 30_000 and data["objects"] == 10_000
    ids = data["ids"][0].tolist()
    counts = np.bincount(pairs.ravel(), minlength=30_000)
    assert data["overlaps"][-1].tolist() == counts[ids].tolist()
    wanted = set(ids[:50])
    expected = {i: [] for i in wanted}
    for a, b in pairs.tolist():
        if a in wanted:
            expected[a].append(b)
        if b in wanted:
            expected[b].append(a)
    assert data["partners"][:50] == [sorted(expected[i])[: data["most_partners"]] for i in ids[:50]]


def test_a_page_has_at_most_6_megabytes():
    random = np.random.default_rng(4)
    lower = random.uniform(0, 10, (600, 1000, 3)).astype(np.float32)  # nothing that could be compressed
    page = broadcl.view(np.concatenate([lower, lower + 1], axis=2))
    data = contents(page)
    assert len(page.html) <= 6_000_000 and data["recorded_frames"] == 600 and data["frames"] > 100


def test_text_is_escaped():
    page = broadcl.view(uniform(3), title="<b>&\"'</script>")
    assert "<b>" not in page.html and page.html.count("</script>") == 3
    assert contents(page)["scenario"] == "<b>&\"'</script>"
    assert 'srcdoc="&lt;!DOCTYPE' in page._repr_html_()
    assert not re.search(r"(src|href)=|https?:|url\(", page.html)


@pytest.mark.parametrize("boxes, error", [
    (np.ma.masked_equal(np.eye(6), 1), "masked values"), (np.full((2, 6), 2**60), "an integer beyond 2"),
    ([[0, 0, 0, 1, np.nan, 1]], "frame 0: the box of object 0 has a NaN"), (np.zeros((2, 5)), "the shape is"),
    (np.zeros((2, 2, 2, 6)), "a frame is not"), (np.empty((0, 4, 6)), "there is no frame"),
])
def test_what_is_no_boxes_is_refused(boxes, error):
    with pytest.raises(ValueError, match=error):
        broadcl.view(boxes)


def test_other_types_are_refused():
    with pytest.raises(TypeError, match="complex"):
        broadcl.view(np.zeros((3, 6), complex))
    for world in (0.5, 2**32, np.nan):
        with pytest.raises(ValueError, match="world: whole numbers"):
            broadcl.view(uniform(3), world=world)


def program(*arguments, cwd):
    return subprocess.run([sys.executable, "-m", "broadcl", "view", *arguments], capture_output=True, text=True, cwd=cwd)


def shown(tmp_path, name):
    run = program(name, "--out", "page.html", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    page = broadcl.Page((tmp_path / "page.html").read_text())
    return contents(page), run


def test_files(tmp_path):
    frames = steps()
    np.save(tmp_path / "a.npy", frames)
    np.savez_compressed(tmp_path / "a.npz", boxes=frames[0], group=np.full(60, 4))
    rows = [(f, i + 5, i % 2, *box) for f, frame in enumerate(frames.astype(np.float64)) for i, box in enumerate(frame.tolist())]
    np.random.default_rng(1).shuffle(rows)
    text = "frame,id,world,a,b,c,d,e,f\n" + "\n".join(",".join(map(repr, map(float, row))) for row in rows)
    (tmp_path / "a.csv").write_text(text)
    expect_pairs(shown(tmp_path, "a.npy")[0], [oracle(frame) for frame in frames])
    assert set(shown(tmp_path, "a.npz")[0]["filters"][0, :60]) == {4}
    data = shown(tmp_path, "a.csv")[0]
    assert data["ids"][0].tolist() == list(range(5, 65)) and data["frames"] == 7
    pairs = oracle(frames[3])
    assert data["curve"][3, 0] == (pairs.sum(axis=1) % 2 == 0).sum()
    np.savetxt(tmp_path / "b.csv", frames[0][:, [0, 1, 3, 4]], delimiter=",")
    assert shown(tmp_path, "b.csv")[0]["high"][2] == 0
    (tmp_path / "c.csv").write_text("# of a program, in metres\n0 0 0; 1 1 1\n\n1 0 0; 2 1 1  # touches\n")
    expect_pairs(shown(tmp_path, "c.csv")[0], [np.array([[0, 1]])])
    np.savez(tmp_path / "b.npz", frames[0])
    expect_pairs(shown(tmp_path, "b.npz")[0], [oracle(frames[0])])
    run = program("a.npy", cwd=tmp_path)
    assert run.stdout.startswith("'a.html' (") and (tmp_path / "a.html").exists()


@pytest.mark.parametrize("name, text, error", [
    ("a.txt", "", "its name ends in none of .npy, .npz, .csv, .aabbs"), ("a.npy", "x", "cannot use"), ("a.npz", "PK", "cannot use"),
    ("a.csv", "1,2,x,4,5,6\n", "cannot use"), ("a.csv", "", "(n, 6) is needed"),
    ("a.csv", "a,b,c,d,e,f\n", "(n, 6) is needed"), ("a.csv", "1,2\n1,2,3\n", "cannot use"),
    ("a.csv", "1,2,3\n", "(n, 6) is needed"),
    ("a.csv", "id,a,b,c,d\n1,0,0,1,1\n1,0,0,1,1\n", "an id is there twice"),
    ("a.csv", "id,a,b,c,d\n-1,0,0,1,1\n", "id: whole numbers"),
    ("a.csv", "1,2,3,4,5,nan\n", "has a NaN"), ("a.aabbs", "", "ends within its header"),
    ("a.aabbs", "x" * 400, "neither a recording"),
])  # fmt: skip
def test_files_that_are_refused(tmp_path, name, text, error):
    (tmp_path / name).write_text(text)
    run = program(name, cwd=tmp_path)
    assert run.returncode == 2 and run.stderr.startswith(f"broadcl: cannot use '{name}': ") and error in run.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_what_cannot_be_read_or_written(tmp_path):
    run = program("none.npy", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "broadcl: cannot read 'none.npy': No such file or directory\n")
    np.save(tmp_path / "a.npy", uniform(3))
    run = program("a.npy", "--out", "no/page.html", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (2, "broadcl: cannot write 'no/page.html': No such file or directory\n")


def frame_bytes(ids, boxes, filters=(), reaches=(), gone=(), exclusions=None):
    def words(rows):
        return np.array(rows, "<u4").tobytes()

    rest = words(ids) + np.array(boxes, "<f4").tobytes() + words([len(filters)]) + words(filters) + words([len(reaches)])
    rest += b"".join(struct.pack("<If", *row) for row in reaches) + words([len(gone)]) + words(gone)
    rest += words([0]) if exclusions is None else words([1, len(exclusions)]) + words(exclusions)
    return b"FRAM" + struct.pack("<IQ", len(ids), len(rest)) + rest


def recording(distance=0.0):
    """Boxes 3, 5, 6 and 9, which come and go; all that are there overlap."""
    box, everything = [0, 0, 0, 1, 1, 1], 2**32 - 1
    return b"BroadCL\n" + struct.pack("<IIdQ", 1, 32, distance, 0) + b"".join([
        frame_bytes([3, 5, 9], [box] * 3, exclusions=[[5, 9]]),
        frame_bytes([3, 5, 6, 9], [box] * 4, filters=[[6, 1, everything, everything, 7]]),
        frame_bytes([3, 6, 9], [box] * 3, gone=[5, 6], exclusions=[]),
        frame_bytes([3, 9], [[5, 0, 0, 6, 1, 1], box], reaches=[[3, 2.5], [9, 2]], gone=[6]),
    ])  # fmt: skip


def test_a_recording(tmp_path):
    (tmp_path / "a.aabbs").write_bytes(recording())
    data = shown(tmp_path, "a.aabbs")[0]
    assert data["ids"][0].tolist() == [3, 5, 6, 9]
    pairs = [["3-5", "3-9"], ["3-5", "3-9"], ["3-6", "3-9", "6-9"], ["3-9"]]
    expected = [[[int(b) for pair in frame for a, b in (pair.split("-"), pair.split("-")[::-1]) if a == str(i)]
                 for i in (3, 5, 6, 9)] for frame in pairs]  # fmt: skip
    assert data["partners"] == list(itertools.chain(*expected))
    assert data["curve"].tolist() == [[2, 2, 0], [2, 0, 0], [3, 2, 1], [1, 0, 2]]
    absent = data["boxes"].reshape(4, 6, 4)[:, 0] == 65535
    assert absent.tolist() == [[False, False, True, False], [False] * 4, [False, True, False, False], [False, True, True, False]]


def test_of_a_recording_whose_program_died_all_but_the_last_frame_is_shown(tmp_path):
    whole = recording()
    for missing in (1, 20, 60):
        (tmp_path / "a.aabbs").write_bytes(whole[:-missing])
        data, run = shown(tmp_path, "a.aabbs")
        assert data["frames"] == 3 and run.stderr == "broadcl: 'a.aabbs' ends within frame 3, which is left out\n"


def test_a_broken_recording_is_refused_or_shown(tmp_path, capsys):
    from broadcl import _view

    random, whole, path = np.random.default_rng(1), recording(), tmp_path / "a.aabbs"
    refused = 0
    for _ in range(400):
        broken = bytearray(whole)
        for at in random.integers(8, len(whole), random.integers(1, 4)):
            broken[at] = random.choice([0, 1, 127, 255])
        path.write_bytes(broken)
        try:
            _view.view_file(path)
        except ValueError as error:
            assert str(error).startswith(f"cannot use '{path}': ")
            refused += 1
    assert 100 < refused < 400
    capsys.readouterr()


def test_a_recording_of_broadmark(tmp_path):
    frames = steps()
    header = bytes(256) + struct.pack("<4i", 60, 6, 0, 0) + bytes(32)
    padded = np.concatenate([frames[..., :3], np.zeros((7, 60, 1)), frames[..., 3:], np.zeros((7, 60, 1))], axis=2)
    whole = header + padded.astype("<f4").tobytes()
    path = Path(tmp_path / "a.aabbs")
    path.write_bytes(whole)
    expect_pairs(shown(tmp_path, "a.aabbs")[0], [oracle(frame) for frame in frames])
    path.write_bytes(whole[:-1])
    assert "bytes of boxes" in program("a.aabbs", cwd=tmp_path).stderr
