"""Files that are cut off, garbled, foreign, endless or no files at all."""

import io
import json
import os
import re

import numpy as np

ODD_VALUES = [
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, float("nan"), float("inf"), 10**30, "", "x", "ä\n|<b>", [], [[]],
    [1], {}, {"a": 1}, "9" * 5000, 2**31, -(2**63),
]  # fmt: skip
NUMBER = re.compile(rb"(?<![\w.])-?\d+(?:\.\d+)?(?:e-?\d+)?")
ODD_NUMBERS = [b"nan", b"inf", b"-1", b"0", b"1e308", b"1e-320", b"-0.0", b"9" * 400, b"x", b"", b"1 2", b"0x7f"]


def garbled(rng, content, others):
    """Bytes of a file after something went wrong with them.

    Args:
        rng: that draws what.
        content: of the file.
        others: contents of other files.
    """
    size = max(len(content), 1)
    at, to = np.sort(rng.integers(0, size + 1, 2))
    match rng.integers(12):
        case 0:
            return content[:at]
        case 1:
            return b""
        case 2:
            return content[:at] + content[to:]
        case 3:
            return content[:at] + bytes(to - at) + content[to:]
        case 4:
            return content[:to] + content[at:]
        case 5:
            return others[rng.integers(len(others))]
        case 6:
            return content[:at] + rng.bytes(rng.integers(1, 50)) + content[at:]
        case 7:
            return content + rng.bytes(rng.integers(1, 5000))
        case 8:
            return b"\xef\xbb\xbf" + content
        case 9:
            return content.decode("latin-1").encode(["utf-16", "utf-32", "utf-8"][rng.integers(3)])
        case 10:
            found = list(NUMBER.finditer(content))
            if not found:
                return content[at:]
            number = found[rng.integers(len(found))]
            odd = ODD_NUMBERS[rng.integers(len(ODD_NUMBERS))]
            return content[: number.start()] + odd + content[number.end() :]
    flipped = bytearray(content or b"\0")
    for _ in range(rng.integers(1, 9)):
        flipped[rng.integers(len(flipped))] ^= 1 << rng.integers(8)
    return bytes(flipped)


def odd_json(rng, content):
    """JSON of which a value is another one, gone or of another name, or only brackets."""
    tree = json.loads(content)
    place, key = _place(rng, tree)
    match rng.integers(6):
        case 0 | 1 | 2:
            place[key] = ODD_VALUES[rng.integers(len(ODD_VALUES))]
        case 3:
            del place[key]
        case 4:
            if rng.random() < 0.1:
                return b"[" * 100_000
            place[key] = [place[key]]
        case 5:
            if isinstance(place, dict):
                place[f"{key}2"] = place.pop(key)
    return json.dumps(tree).encode()


def _place(rng, tree):
    """A container of the tree, and one of its keys."""
    while True:
        keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
        key = keys[rng.integers(len(keys))]
        if not isinstance(tree[key], dict | list) or not tree[key] or rng.random() < 0.2:
            return tree, key
        tree = tree[key]


def odd_arrays(rng, content):
    """A file of arrays of which one is odd."""
    arrays = dict(np.load(io.BytesIO(content)))
    name = list(arrays)[rng.integers(len(arrays))]
    values = arrays[name]
    match rng.integers(10):
        case 0:
            del arrays[name]
        case 1:
            arrays[name] = values[:-1] if values.ndim else values[None]
        case 2:
            arrays[name] = values[None]
        case 3:
            arrays[name] = np.zeros(values.shape, ["U3", "S2", "M8[s]", "c16", "f2"][rng.integers(5)])
        case 4:
            arrays[name] = (
                values.astype(float, casting="unsafe") * np.nan if values.dtype.kind in "biuf" else values[()]
            )
        case 5:
            arrays[name] = np.zeros((0,) * max(values.ndim, 1))
        case 6:
            arrays[name] = np.array([{"an": "object"}])
        case 7:
            other = list(arrays.values())[rng.integers(len(arrays))]
            arrays[name] = other
        case 8:
            arrays["strange"] = np.zeros(3)
        case 9:
            if values.size and values.dtype.kind in "iuf":
                values = values.copy()
                odd = [-1, 2**31 - 1, 1000][rng.integers(3)]
                values.reshape(-1)[rng.integers(values.size)] = np.array(odd).astype(values.dtype)
                arrays[name] = values
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def replace_by_no_file(rng, path):
    """Put something at the path that is no plain file of a fair size; return what."""
    path.unlink(missing_ok=True)
    kinds = ["fifo", "folder", "loop", "dangling", "zeros", "gone", "forbidden", "sparse"]
    kind = kinds[rng.integers(len(kinds))]
    match kind:
        case "fifo":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "loop":
            path.symlink_to(path.name)
        case "dangling":
            path.symlink_to("nowhere")
        case "zeros":
            path.symlink_to("/dev/zero")
        case "forbidden":
            path.write_bytes(b"{}")
            path.chmod(0)
        case "sparse":
            with open(path, "wb") as file:
                file.truncate(2**36)
    return kind


def remove(path):
    """Remove whatever is at the path."""
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    else:
        path.unlink(missing_ok=True)
