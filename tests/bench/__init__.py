"""Benchmarks: programs that report numbers with the machine they ran on. Nothing here is a test."""
