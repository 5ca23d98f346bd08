"""``python -m swashtwin`` is the command ``swashtwin``."""

from swashtwin.cli import main

if __name__ == "__main__":
    main()
