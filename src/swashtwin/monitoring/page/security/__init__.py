"""Who may use the page, and what is refused before it is asked."""
