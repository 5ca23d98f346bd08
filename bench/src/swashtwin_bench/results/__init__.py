"""What studies give back: runs, tables, contrasts, answers, and their figures and report
sections.
"""
