"""The watch itself: from a delivered recording to its verdict, its alarm and the message about
it.
"""
