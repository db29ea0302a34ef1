"""Optimal control of a ferroelectric (thesis chapter 4): the problem, its transcriptions, solvers and sensitivities."""
