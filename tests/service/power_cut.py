#!/usr/bin/env python3
"""Cuts the power at every moment of `rigd archive`, `rigd backup` and `rigd restore`: a run is never lost, and what a
command has reported as done is there.

    tests/service/power_cut.py target/release/rigd

`strace` must be installed; it records what a command writes. A cut leaves the worst that a disk may keep: of a file what
it had at its last fsync, and of a directory the names that it had at its own last fsync. Standard library only.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

RIGD = Path(sys.argv[1]).resolve()
ROOT = Path(__file__).resolve().parents[2]
CALLS = "openat,write,pwrite64,copy_file_range,sendfile,ftruncate,fsync,fdatasync,rename,unlink,unlinkat,mkdir,rmdir"
LINE = re.compile(r"(?:\d+ +)?(\w+)\((.*)\) += (-?\d+)")
HANDLE = re.compile(r"(\w+)<(.*)>")


class File:
    def __init__(self, content=b""):
        self.content, self.kept = bytearray(content), bytes(content)


class Folder:
    def __init__(self):
        self.names, self.kept = {}, {}


def snapshot(path):
    """A directory whose content is on the disk."""
    folder = Folder()
    for entry in path.iterdir():
        folder.names[entry.name] = snapshot(entry) if entry.is_dir() else File(entry.read_bytes())
    folder.kept = dict(folder.names)
    return folder


def put_back(folder, path):
    """What a cut leaves of a directory. Memory that SQLite shares between programs is on no disk."""
    path.mkdir()
    for name, node in folder.kept.items():
        if isinstance(node, Folder):
            put_back(node, path / name)
        elif not name.endswith("-shm"):
            (path / name).write_bytes(node.kept)


def unescaped(text):
    return re.sub(r"\\x(..)", lambda match: chr(int(match[1], 16)), text)


class Disk:
    def __init__(self, root):
        self.root, self.tree, self.places = root, snapshot(root), {}

    def parts(self, path):
        path = Path(path) if path.startswith("/") else self.root / path
        return path.relative_to(self.root).parts if path.is_relative_to(self.root) else None

    def node(self, path):
        parts = self.parts(path)
        node = None if parts is None else self.tree
        for part in parts or ():
            node = node.names.get(part) if isinstance(node, Folder) else None
        return node

    def above(self, path):
        parts = self.parts(path)
        return self.node(str(self.root.joinpath(*parts[:-1]))) if parts else None, parts[-1] if parts else None

    def write(self, handle, path, data, at=None):
        node = self.node(path)
        if not isinstance(node, File):
            return
        begin = self.places.get(handle, 0) if at is None else at
        node.content[len(node.content):begin] = bytes(max(0, begin - len(node.content)))
        node.content[begin:begin + len(data)] = data
        if at is None:
            self.places[handle] = begin + len(data)

    def play(self, call, arguments, result):
        """Follows a call. Returns whether what a cut leaves may be another now."""
        texts = [unescaped(one.strip('"')) for one in arguments]
        found = [HANDLE.fullmatch(one) for one in arguments]
        handles = [(one[1], unescaped(one[2])) if one else None for one in found]
        if call == "openat":
            folder, name = self.above(texts[1])
            flags = arguments[2]
            self.places[str(result)] = 0
            if folder and name not in folder.names and "O_CREAT" in flags:
                folder.names[name] = File()
                folder.names[name].kept = b""
            elif folder and "O_TRUNC" in flags and isinstance(folder.names[name], File):
                folder.names[name].content.clear()
        elif call in ("write", "pwrite64"):
            at = int(arguments[3]) if call == "pwrite64" else None
            self.write(*handles[0], texts[1].encode("latin1")[:result], at)
        elif call in ("copy_file_range", "sendfile"):
            (source, path), target = (handles[0], handles[2]) if call == "copy_file_range" else (handles[1], handles[0])
            begin = self.places.get(source, 0)
            self.places[source] = begin + result
            self.write(*target, bytes(self.node(path).content[begin:begin + result]))
        elif call == "ftruncate" and isinstance(node := self.node(handles[0][1]), File):
            length = int(arguments[1])
            node.content[length:] = bytes(max(0, length - len(node.content)))
        elif call in ("fsync", "fdatasync") and (node := self.node(handles[0][1])):
            node.kept = bytes(node.content) if isinstance(node, File) else dict(node.names)
            return True
        elif call == "rename":
            (source, old), (target, new) = self.above(texts[0]), self.above(texts[1])
            if source and target:
                target.names[new] = source.names.pop(old)
        elif call == "mkdir":
            folder, name = self.above(texts[0])
            if folder:
                folder.names[name] = Folder()
        elif call in ("unlink", "rmdir", "unlinkat"):
            path = texts[0]
            if call == "unlinkat":
                path = texts[1] if texts[1].startswith("/") else str(Path(handles[0][1]) / texts[1])
            folder, name = self.above(path)
            if folder:
                folder.names.pop(name, None)
        return False


def rigd(folder, *arguments):
    return subprocess.run([RIGD, *arguments], cwd=folder, capture_output=True, text=True)


def has(folder, data, run="smoke-1"):
    """Whether a directory has the run with its readings, in order."""
    readings = rigd(folder, "export", run, "--format", "csv", "--table", "readings", "--data", data)
    return readings.returncode == 0 and rigd(folder, "verify", run, "--data", data).returncode == 0


def cut(start, arguments, is_well, is_done):
    """Plays a command on a copy of `start`, and cuts after each fsync. Returns how many different states that gave."""
    with tempfile.TemporaryDirectory() as folder:
        work, trace = Path(folder) / "work", Path(folder) / "trace"
        subprocess.run(["cp", "-a", start, work], check=True)
        disk, seen = Disk(work), set()
        done = subprocess.run(["strace", "-f", "-y", "-qq", "-xx", "-s", "4194304", "-o", trace, "-e", f"trace={CALLS}",
                               RIGD, *arguments], cwd=work, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr

        def check(name, is_right):
            left = Path(folder) / f"left-{name}"
            put_back(disk.tree, left)
            state = {str(path.relative_to(left)): path.read_bytes() if path.is_file() else b"" for path in left.rglob("*")}
            key = hash(tuple(sorted(state.items())))
            if key in seen and is_right is is_well:
                return
            seen.add(key)
            if not is_right(left):
                kept = sorted(path for path in state if "/runs/" not in path)
                sys.exit(f"FAILED: rigd {' '.join(arguments)}, power cut at {name}; on the disk: {kept}")
            subprocess.run(["rm", "-rf", left], check=True)

        with open(trace, errors="replace") as lines:
            for number, line in enumerate(lines):
                match = LINE.match(line)
                if match and int(match[3]) >= 0:
                    # What is quoted is in hexadecimal and has no comma.
                    if disk.play(match[1], match[2].split(", "), int(match[3])):
                        check(f"call {number}", is_well)
        check("the end", is_done)
        return len(seen)


def main():
    with tempfile.TemporaryDirectory() as folder:
        start = Path(folder) / "start"
        start.mkdir()
        made = rigd(ROOT, "run", "config/protocols/smoke.toml", "--rig", "config/rigs/simulated.toml", "--data", start / "data")
        assert made.returncode == 0, made.stderr
        note = json.dumps({"a run": {"note": "good", "is_starred": True}})
        (start / "data/notes.json").write_text(note)
        in_journal, in_archive = (lambda left: has(left, "data")), (lambda left: has(left, "new/archive"))
        states = cut(start, ("archive", "new/archive", "smoke-1", "--data", "data"),
                     lambda left: in_journal(left) or in_archive(left), in_archive)
        print(f"rigd archive: the run is in the journal or in the archive after each of {states} power cuts")
        in_backup = lambda left: has(left, "new/backup")
        states = cut(start, ("backup", "new/backup", "--data", "data"), in_journal, in_backup)
        print(f"rigd backup: the journal is whole after each of {states} power cuts, and at the end the backup is")
        assert rigd(start, "backup", "backup", "--data", "data").returncode == 0
        is_whole = lambda left: has(left, "new/data") and (left / "new/data/notes.json").read_text() == note
        is_absent = lambda left: not (left / "new/data/rigd.db").exists()
        states = cut(start, ("restore", "backup", "--data", "new/data"), lambda left: is_absent(left) or is_whole(left), is_whole)
        print(f"rigd restore: the data are whole or not there after each of {states} power cuts")


main()
