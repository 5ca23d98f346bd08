"""The page of the watch: machines, trends, recordings and alarms in a browser, and the same for
programs.
"""
