"""Put the committed results of studies/ and benchmarks/ on the site.

So no table or picture is copied by hand.
"""

from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
FOLDERS = ("studies", "benchmarks")
# the glossary, which stands at the end of a report too
WORDS = "tactile_viewgcn/pages/templates/words.md"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the tables and pictures of studies/ and benchmarks/, and the glossary.

    Each studies/NAME/*.md and *.png keeps its path, as do those of benchmarks/.
    """
    files.append(File.generated(config, "words.md", abs_src_path=str(ROOT / WORDS)))
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).glob("*/*")):
            if path.suffix in (".md", ".png"):
                name = path.relative_to(ROOT).as_posix()
                files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Give a table of results its folder's name as title; shorten `../studies/` to `studies/`.

    Links are written with `../`, so that they also work where the sources are read.
    """
    folder, _, name = page.file.src_uri.partition("/")
    if folder in FOLDERS and not markdown.startswith("# "):
        markdown = f"# {name.removesuffix('.md').replace('/', ': ')}\n\n{markdown}"
    for folder in FOLDERS:
        markdown = markdown.replace(f"](../{folder}/", f"]({folder}/")
    return markdown.replace(f"](../{WORDS})", "](words.md)")
