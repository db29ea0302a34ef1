"""Faults, each made on purpose: what happens, how soon, and whether that is what was promised (docs/faults.md)."""
