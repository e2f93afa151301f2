"""What `make docs` needs besides MkDocs: a hook, named in mkdocs.yml.

- The README is the first page, and whatever of the repository a page links to outside of docs/
  (tables and pictures under results/, the changelog, ...) comes along, under its own path.
- A block of language `math` is LaTeX, which becomes MathML: no script has to be loaded for it.
- A page that would load anything from a network is a warning, hence an error in strict mode.
"""

import logging
import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

logger = logging.getLogger("mkdocs.hooks.docs_site")

ROOT = Path(__file__).resolve().parent.parent
DOCS = "docs"
README, INDEX = "README.md", "index.md"
# pages that no other page need link to
ALSO = ("CHANGELOG.md", "CONTRIBUTING.md")
LINK = re.compile(r"(\]\()([^)\s#]+)(#[^)\s]*)?(\))")
LOADED = re.compile(
    r"<(?:script|img|iframe|link rel=\"(?:stylesheet|preconnect)\")[^>]*https?://[^>]*>"
)
# what a link to a folder opens
FRONT = ("table.md", "README.md", "rows.csv", "noise_sweep/table.md")


def on_config(config: Any) -> Any:
    """Adds the format for equations."""
    fences = config["mdx_configs"].setdefault("pymdownx.superfences", {})
    fences["custom_fences"] = [{"name": "math", "class": "math", "format": equation}]
    return config


def equation(source: str, *_: Any, **__: Any) -> str:
    """A block of LaTeX as MathML."""
    return f'<div class="math">{convert(source, display="block")}</div>'


def on_files(files: Files, config: Any) -> Files:
    """Adds the README and all that is linked to outside of docs/."""
    waiting = [f"{DOCS}/{file.src_uri}" for file in files.documentation_pages()]
    files.append(File.generated(config, INDEX, abs_src_path=str(ROOT / README)))
    for name in ALSO:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    waiting += [README, *ALSO]
    seen = set(waiting)
    while waiting:
        page = waiting.pop()
        if not page.endswith(".md"):
            continue
        for found in LINK.finditer((ROOT / page).read_text(encoding="utf-8")):
            target = in_repository(page, found[2])
            if target is None or target in seen or target.startswith(f"{DOCS}/"):
                continue
            seen.add(target)
            waiting.append(target)
            files.append(File.generated(config, target, abs_src_path=str(ROOT / target)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turns links from the repository's paths into the site's."""
    source = page.file.src_uri
    here = Path(page.file.abs_src_path).relative_to(ROOT).as_posix()

    def changed(found: re.Match[str]) -> str:
        target = in_repository(here, found[2])
        if target is None:
            return found[0]
        place = INDEX if target == README else target.removeprefix(f"{DOCS}/")
        relative = posixpath.relpath(place, posixpath.dirname(source) or ".")
        return f"{found[1]}{relative}{found[3] or ''}{found[4]}"

    return LINK.sub(changed, markdown)


def in_repository(page: str, link: str) -> str | None:
    """The file of the repository that a page's link leads to; None for any other link."""
    if "://" in link or link.startswith("mailto:"):
        return None
    target = posixpath.normpath(posixpath.join(posixpath.dirname(page), link))
    if (ROOT / target).is_dir():
        names = (f"{target}/{name}" for name in FRONT)
        target = next((name for name in names if (ROOT / name).is_file()), "")
    return target if target and (ROOT / target).is_file() else None


def on_post_build(config: Any) -> None:
    """Warns of whatever a page would load from a network."""
    for path in Path(config["site_dir"]).rglob("*.html"):
        for found in LOADED.findall(path.read_text(encoding="utf-8")):
            logger.warning("%s loads from a network: %s", path.name, found[:120])
