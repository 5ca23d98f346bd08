"""The addresses of the page: pages, forms, figures, programs, files, live changes."""
