"""Forms of single steps that no option offers, measured so that their price can be read.

Each is the same kernel with other arithmetic, or the same sums stored otherwise. A process measures
all values of a form in turns: `python -m gstream.report.forms JSON`.
"""
