"""Templates of HTML pages."""

from jinja2 import Environment, PackageLoader, StrictUndefined


def load_templates(package: str, folder: str = "templates") -> Environment:
    """Return the templates of a package: they escape what they insert, and require each name.

    Parameters
    ----------
    folder : folder of the templates in the package; empty for the package's own folder.
    """
    return Environment(
        loader=PackageLoader(package, folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
