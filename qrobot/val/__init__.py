"""VAL II: programs in the language that PUMA arms came with, each line a step.

`source` reads files by `parser` into `tree`, and prints them by `printer`; `structure` makes jumps of IF, FOR and such.
`check` looks at a program before anything moves.
"""
