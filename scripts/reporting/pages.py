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


def title_of(notebook):
    """Return the notebook's first heading."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown" and cell.source.startswith("# "):
            return cell.source.splitlines()[0][2:]
    raise ValueError("the notebook has no heading '# ...' that could name its page")


def page_of(notebook, template):
    """Return the HTML page of an executed notebook, code left out."""
    from nbconvert import HTMLExporter

    exporter = HTMLExporter(template_name="basic", exclude_input=True, exclude_output_prompt=True, anchor_link_text="")
    body, _ = exporter.from_notebook_node(notebook)
    return render(template, title=title_of(notebook), body=body)


def pictures_of(notebook, tag="report"):
    """Return the HTML that cells with a tag displayed, joined."""
    parts = []
    for cell in notebook.cells:
        if tag in cell.metadata.get("tags", []) and cell.cell_type == "code":
            parts += [o.data["text/html"] for o in cell.outputs if "text/html" in o.get("data", {})]
    return "\n".join(parts)


def lead_of(notebook):
    """Return the HTML of what the notebook's first cell says below its title: how to read the pictures."""
    from nbconvert.filters import markdown2html

    return markdown2html(notebook.cells[0].source.partition("\n")[2])


def sections_of(notebooks):
    """Return a dict a notebook: ``name``, ``title``, ``lead``, ``page`` (its HTML file), ``pictures``, ``front`` (those
    that the report starts with).
    """
    import nbformat

    sections = []
    for path in notebooks:
        notebook = nbformat.read(path, as_version=4)
        name = Path(path).stem
        sections.append(
            {
                "name": name,
                "title": title_of(notebook),
                "lead": lead_of(notebook),
                "page": f"{name}.html",
                "pictures": pictures_of(notebook),
                "front": pictures_of(notebook, "front"),
            }
        )
    return sections
