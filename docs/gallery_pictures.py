"""Hook of MkDocs: the gallery shows the pictures of the default study where they have been made."""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.structure.files import File

RESULTS = Path("results/thesis")
PICTURE = re.compile(r"<!-- picture: (.+\.svg) -->")


def _matching_pictures(pattern: str) -> list[Path]:
    """Return the pictures that match a name; a part in braces, such as a lift, matches anything."""
    return sorted(RESULTS.glob(re.sub(r"\{\w+\}", "*", pattern)))


def on_files(files, config):
    """Add the pictures to the site's files."""
    page = (Path(config.docs_dir) / "gallery.md").read_text(encoding="utf-8")
    for path in (path for pattern in PICTURE.findall(page) for path in _matching_pictures(pattern)):
        files.append(File.generated(config, f"gallery/{path.relative_to(RESULTS)}", abs_src_path=str(path)))
    return files


def on_page_markdown(markdown, page, config, files):
    """Insert the pictures into the gallery page."""
    if page.file.src_uri != "gallery.md":
        return markdown
    return PICTURE.sub(
        lambda found: "\n\n".join(
            f"![](gallery/{path.relative_to(RESULTS)})" for path in _matching_pictures(found[1])
        ),
        markdown,
    )
