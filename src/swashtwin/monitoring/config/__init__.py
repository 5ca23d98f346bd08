"""Configuration of a watch: a TOML file with machines, sources of recordings, alarms, channels and
the page.
"""
