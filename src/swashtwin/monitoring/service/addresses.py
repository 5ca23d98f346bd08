"""Where people find the page."""

from swashtwin.monitoring.config import PageSettings


def page_address(page: PageSettings) -> str:
    """Address of the page: of the proxy that serves it, if one is configured.

    Examples
    --------
    >>> page_address(PageSettings()), page_address(PageSettings(hosts=("watch.plant.example",), secure=True))
    ('http://127.0.0.1:8642', 'https://watch.plant.example')
    """
    if page.hosts and page.secure:
        return f"https://{page.hosts[0]}"
    host = f"[{page.host}]" if ":" in page.host else page.host
    return f"http://{host}:{page.port}"
