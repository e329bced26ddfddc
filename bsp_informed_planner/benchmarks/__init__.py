"""Benchmarks: numbers on random problems, with raw rows, tables and pictures.

`benchmark` says what a benchmark is made of, `runner` runs one, `report` writes what came of it. A benchmark of a part
of the package is a folder of its own here.
"""
