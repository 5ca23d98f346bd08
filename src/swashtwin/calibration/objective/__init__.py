"""What is searched, what it is compared with, and how the difference is measured."""
