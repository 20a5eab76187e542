"""References of the docstrings, such as :class:`~wbc.laws.VelocityLaw`, as links of the site."""

import re

import griffe

ROLE = re.compile(r":(?:class|meth|func|mod|attr|exc|data):`(~?)([\w.]+)`")


def link(found: re.Match[str]) -> str:
    """Return an optional reference: a link where the site has the object, else its name."""
    short, path = found.groups()
    name = path.rpartition(".")[2] if short else path.lstrip(".")
    return f'<autoref identifier="{path.lstrip(".")}" optional><code>{name}</code></autoref>'


class Roles(griffe.Extension):
    """Rewrites the docstring of each object."""

    def on_object(self, *, obj: griffe.Object, **kwargs: object) -> None:
        """Replace the roles."""
        if obj.docstring is not None:
            obj.docstring.value = ROLE.sub(link, obj.docstring.value)
