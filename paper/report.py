"""Write the report: its text is paper/report.md.j2, its numbers come out of paper/results, its figures of paper/images.

    python -m paper.report --out paper/report.md [--html report.html]

The HTML is one file with its images inside. Both are whole or not written at all.
"""

import argparse
import base64
import re
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, TemplateError
from markdown_it import MarkdownIt

from jaxmm.files import write_text
from jaxmm.inputs import InputError
from paper.report_values import Results

HERE = Path(__file__).resolve().parent
TEMPLATE, RESULTS = "report.md.j2", HERE / "results"
STYLE = """body { font: 16px/1.5 system-ui, sans-serif; color: #1b1f24 }
body { max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
table { border-collapse: collapse; font-size: 0.82rem; display: block; overflow-x: auto }
th, td { border: 1px solid #d0d7de; padding: 0.25rem 0.5rem; text-align: left; white-space: nowrap }
th { background: #f3f5f7 } img { max-width: 100% } code { background: #f3f5f7; padding: 0 0.2em }
@media print { body { max-width: none; font-size: 11px } table { font-size: 8px; display: table } }"""


def report(results: Path = RESULTS) -> str:
    """The report in Markdown.

    Raises:
        InputError: results are missing, or do not hold what the text asks for.
    """
    environment = Environment(
        loader=FileSystemLoader(HERE), undefined=StrictUndefined, keep_trailing_newline=True, autoescape=False
    )
    try:
        return environment.get_template(TEMPLATE).render(run=Results(results))
    except (TemplateError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{results}: expected results of configs/paper.toml, {TEMPLATE} wants {error}") from error


def as_html(markdown: str, folder: Path = HERE) -> str:
    """One page of it; images are taken from `folder` and put inside."""
    body = MarkdownIt("commonmark").enable("table").render(markdown)

    def inlined(match: re.Match[str]) -> str:
        data = base64.b64encode((folder / match[1]).read_bytes()).decode()
        return f'src="data:image/png;base64,{data}"'

    body = re.sub(r'src="([^":]+\.png)"', inlined, body)
    title = markdown.split("\n", 1)[0].lstrip("# ")
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    return f'<!doctype html>\n<html lang="en"><head>{head}<style>{STYLE}</style></head>\n<body>\n{body}</body></html>\n'


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--results", type=Path, default=RESULTS, metavar="DIR", help="default: paper/results")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="Markdown file to write")
    parser.add_argument("--html", type=Path, metavar="FILE", help="also write it as one HTML file")
    asked = parser.parse_args()
    try:
        text = report(asked.results)
        write_text(asked.out, text)
        if asked.html:
            write_text(asked.html, as_html(text))
    except InputError as error:
        parser.exit(2, f"error: {error}\n")
