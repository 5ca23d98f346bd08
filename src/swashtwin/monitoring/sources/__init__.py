"""Where recordings come from: folders, brokers, uploads. Each is on the disk before its source
hears that it came.
"""
