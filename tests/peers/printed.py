#!/usr/bin/env python3
"""Prints the report of a run with Chromium, and reads the pages: how many, and the foot of each.

Usage: printed.py CHROMIUM FOLDER      (the folder of a run of config/protocols/three-direction.toml)
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from pypdf import PdfReader

from bench import check, equal

PAGES_MAX = 5


def main():
    chromium, folder = sys.argv[1], Path(sys.argv[2])
    manifest = json.loads((folder / "manifest.json").read_text())
    with tempfile.TemporaryDirectory() as work:
        path = Path(work) / "report.pdf"
        report = (folder / "report.html").resolve().as_uri()
        subprocess.run([chromium, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer",
                        f"--user-data-dir={work}/profile", f"--print-to-pdf={path}", report],
                       check=True, capture_output=True, timeout=120)
        pages = [page.extract_text() for page in PdfReader(path).pages]
    check(len(pages) <= PAGES_MAX, f"{len(pages)} pages in print")
    for number, text in enumerate(pages, 1):
        check(manifest["run_id"] in text, f"page {number} does not name its run")
        check(f"{number} / {len(pages)}" in text, f"page {number} does not have its number")
    together = " ".join(pages)
    check("Stiffness" in pages[0], "the first page has no stiffness")
    for figure in ("11", "12", "13"):
        check(f"Figure {figure}" in together, f"figure {figure} is not printed")
    equal(manifest["digest"] in together, True, "the digest is printed")
    print(f"the report in print: {len(pages)} pages, each with its run and its number")


main()
