"""Pages of HTML: templates filled in, what executed notebooks display, their titles and first words."""

import base64
from pathlib import Path

import jinja2


def render(template, **values):
    """Return the HTML of a jinja2 template file, which may extend others beside it."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(template).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template(Path(template).name).render(**values)


def data_uri(picture, kind="png"):
    """Return an encoded picture (bytes) as a data URI."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode()}"


def heading_of(notebook):
    """Return (title, the words below it as Markdown) of the notebook's first heading, in a cell of text or displayed by code."""
    for cell in notebook.cells:
        displayed = [output.data.get("text/markdown", "") for output in cell.get("outputs", []) if "data" in output]
        for text in [cell.source] if cell.cell_type == "markdown" else displayed:
            if text.startswith("# "):
                title, _, words = text[2:].partition("\n")
                return title, words
    raise ValueError("the notebook has no heading '# ...' that could name its page")


def page_of(notebook, template):
    """Return the HTML page of an executed notebook, code left out."""
    from nbconvert import HTMLExporter

    exporter = HTMLExporter(template_name="basic", exclude_input=True, exclude_output_prompt=True, anchor_link_text="")
    body, _ = exporter.from_notebook_node(notebook)
    return render(template, title=heading_of(notebook)[0], body=body)


def pictures_of(notebook, tag="report"):
    """Return the HTML that cells with a tag displayed, joined."""
    parts = []
    for cell in notebook.cells:
        if tag in cell.metadata.get("tags", []) and cell.cell_type == "code":
            parts += [o.data["text/html"] for o in cell.outputs if "text/html" in o.get("data", {})]
    return "\n".join(parts)


def sections_of(notebooks):
    """Return a dict a notebook: ``name``, ``title``, ``lead`` (HTML of what stands below the title: how to read the
    pictures), ``page`` (its HTML file), ``pictures``, ``front`` (those that the report starts with).
    """
    import nbformat
    from nbconvert.filters import markdown2html

    sections = []
    for path in notebooks:
        notebook = nbformat.read(path, as_version=4)
        name = Path(path).stem
        title, words = heading_of(notebook)
        sections.append(
            {
                "name": name,
                "title": title,
                "lead": markdown2html(words),
                "page": f"{name}.html",
                "pictures": pictures_of(notebook),
                "front": pictures_of(notebook, "front"),
            }
        )
    return sections
