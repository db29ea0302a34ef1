"""Everything the README claims about speed, measured: `python -m benchmarks [NAME ...]`."""
