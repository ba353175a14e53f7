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
RUN_ID = "fffeffee-ff00-7fff-8eff-0ff1ffdeffff"
DIGEST = "ff0eff1fff2effff" * 4


def main():
    chromium, folder = sys.argv[1], Path(sys.argv[2])
    manifest = json.loads((folder / "manifest.json").read_text())
    with tempfile.TemporaryDirectory() as work:
        path, report = Path(work) / "report.pdf", Path(work) / "report.html"
        # A run id and a digest with every pair of letters that a font may join.
        text = (folder / "report.html").read_text()
        report.write_text(text.replace(manifest["run_id"], RUN_ID).replace(manifest["digest"], DIGEST))
        subprocess.run([chromium, "--headless", "--no-sandbox", "--disable-gpu", "--no-pdf-header-footer",
                        f"--user-data-dir={work}/profile", f"--print-to-pdf={path}", report.as_uri()],
                       check=True, capture_output=True, timeout=120)
        pages = [page.extract_text() for page in PdfReader(path).pages]
    check(len(pages) <= PAGES_MAX, f"{len(pages)} pages in print")
    for number, text in enumerate(pages, 1):
        check(RUN_ID in text, f"page {number} does not name its run")
        check(f"{number} / {len(pages)}" in text, f"page {number} does not have its number")
    together = " ".join(pages)
    check("Stiffness" in pages[0], "the first page has no stiffness")
    for figure in ("11", "12", "13"):
        check(f"Figure {figure}" in together, f"figure {figure} is not printed")
    equal(DIGEST in together, True, "the digest is printed")
    print(f"the report in print: {len(pages)} pages, each with its run and its number")


main()
