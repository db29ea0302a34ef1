"""Everything the README claims about speed, measured: `pzt bench [NAME ...]`, or `python -m pzt_benchmarks`."""
