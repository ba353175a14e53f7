#!/usr/bin/env python3
"""Takes away one guard after another (mutants.toml) in a copy of the sources, and plays the campaign
until it fails, or runs the tests of its crate. Prints the first seed or test that notices, and what it says.
The exit code is 0 only if every mutant was noticed. A row that does not apply ends the program.

    tests/campaign/mutants.py [--only WORD] [--seeds N] [--jobs J]
    tests/campaign/mutants.py --check    only sees that every row applies
"""

import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import time
import tomllib

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCRATCH = ROOT / "target" / "mutants"


def copy_sources(tree):
    """The tracked files; one that has not changed keeps its time, so that it is not built again."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    for name in filter(None, names.stdout.decode().split("\0")):
        source, target = ROOT / name, tree / name
        if target.exists() and target.read_bytes() == source.read_bytes():
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)


def apply(tree, edits):
    for edit in edits:
        path = tree / edit["file"]
        text = path.read_text()
        if text.count(edit["find"]) != 1:
            sys.exit(f"{edit['file']}: found {text.count(edit['find'])} times: {edit['find']}")
        path.write_text(text.replace(edit["find"], edit["replace"]))


# Built again for each row: the time to build counts more than that of the campaign.
ENVIRONMENT = {
    **os.environ,
    "CARGO_TARGET_DIR": str(SCRATCH / "build"),
    "CARGO_PROFILE_RELEASE_INCREMENTAL": "true",
    "CARGO_PROFILE_RELEASE_OPT_LEVEL": "1",
}


def cargo(tree, *arguments):
    command = ["cargo", *arguments]
    return subprocess.run(command, cwd=tree, env=ENVIRONMENT, capture_output=True, text=True)


def build(tree, *arguments):
    built = cargo(tree, *arguments)
    if built.returncode != 0:
        sys.exit(built.stderr)


def by_tests(tree, row):
    """The test of the crate that notices, with what it says; None if none does."""
    tests = ["test", "--quiet", "--locked", "-p", row["package"]]
    build(tree, *tests, "--no-run")
    tested = cargo(tree, *tests)
    if tested.returncode == 0:
        return None
    names = re.findall(r"^---- (.*) stdout ----$", tested.stdout, re.MULTILINE)
    return f"{len(names)} tests | {row['name']} | {', '.join(names)[:160]}"


def by_campaign(tree, row, arguments):
    """The first seed that notices, with what it says; None if none does."""
    build(tree, "build", "--quiet", "--release", "--locked", "-p", "rig-tests", "--bin", "campaign")
    command = [SCRATCH / "build" / "release" / "campaign"]
    command += ["--seeds", str(arguments.seeds), "--jobs", str(arguments.jobs), "--until-failed"]
    command += ["--engine"] if row["by"] == "engine" else []
    played = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    lines = played.stdout.splitlines()
    first = next((i for i, line in enumerate(lines) if re.match(r"seed \d+:", line)), None)
    if played.returncode == 0 or first is None:
        return None
    seed = lines[first].split(":")[0]
    what = lines[first] if row["by"] == "engine" else lines[first + 1]
    return f"{seed} | {row['name']} | {what.strip()[:160]}"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="")
    parser.add_argument("--seeds", type=int, default=6000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    rows = tomllib.loads((ROOT / "tests/campaign/mutants.toml").read_text())["mutant"]
    tree = SCRATCH / "tree"
    copy_sources(tree)
    # All rows must apply before the first one is built.
    for row in rows:
        apply(tree, row["edits"])
        copy_sources(tree)
    if arguments.check:
        print(f"{len(rows)} mutants apply")
        return
    survivors = 0
    rows = [row for row in rows if arguments.only in row["name"]]
    for row in rows:
        begun = time.monotonic()
        apply(tree, row["edits"])
        noticed = by_tests(tree, row) if row["by"] == "tests" else by_campaign(tree, row, arguments)
        copy_sources(tree)
        minutes = (time.monotonic() - begun) / 60
        if noticed is None:
            survivors += 1
            noticed = f"NOT NOTICED | {row['name']}"
        print(f"{noticed} | {minutes:.1f} min", flush=True)
    print(f"{len(rows)} mutants, {survivors} not noticed")
    sys.exit(survivors > 0)


if __name__ == "__main__":
    main()
