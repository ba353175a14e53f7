"""Every link and picture of the built manual leads to a file of it, and none to another host's picture."""

import pathlib
import re
import sys
import urllib.parse

book = pathlib.Path(sys.argv[1])
pages = sorted(book.rglob("*.html"))
assert len(pages) > 10, f"only {len(pages)} pages in {book}"
checked, broken = 0, []
for page in pages:
    if page.name in ("print.html", "404.html", "toc.html"):
        continue
    content = page.read_text().split("<main>")[-1].split("</main>")[0]
    for kind, link in re.findall(r'(href|src)="([^"]+)"', content):
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or link.startswith("#"):
            if kind == "src" and parts.scheme in ("http", "https"):
                broken.append(f"{page.relative_to(book)}: {link} is on another host")
            continue
        # A folder has no page: it is there for readers of the repository.
        if not pathlib.PurePath(parts.path).suffix:
            continue
        checked += 1
        target = (page.parent / urllib.parse.unquote(parts.path)).resolve()
        if not target.exists():
            broken.append(f"{page.relative_to(book)}: {link} leads nowhere")
if broken:
    sys.exit("\n".join(broken))
print(f"{checked} links and pictures of {len(pages)} pages lead somewhere")
