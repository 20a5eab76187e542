"""References of the docstrings, such as :class:`~wbc.laws.VelocityLaw`, as links of the site."""

import re

import griffe

# A role may have a text of its own: :meth:`StandingMotion.of <wbc.retargeting...>`.
ROLE = re.compile(r":(?:class|meth|func|mod|attr|exc|data):`(?:([^`<]+) <)?(~?)([\w.]+)>?`")


def link(found: re.Match[str]) -> str:
    """Return an optional reference: a link where the site has the object, else its name."""
    text, short, path = found.groups()
    name = text or (path.rpartition(".")[2] if short else path.lstrip("."))
    return f'<autoref identifier="{path.lstrip(".")}" optional><code>{name}</code></autoref>'


def name_of(found: re.Match[str]) -> str:
    """Return a reference's name, for pages whose references are no links."""
    return f"`{found[1] or found[3].rpartition('.')[2]}`"


class Roles(griffe.Extension):
    """Rewrites the docstring of each object."""

    def on_object(self, *, obj: griffe.Object, **kwargs: object) -> None:
        """Replace the roles."""
        if obj.docstring is not None:
            obj.docstring.value = ROLE.sub(link, obj.docstring.value)
