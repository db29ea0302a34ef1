"""Starts, watches and stops the node graph; plain Python, knows the nodes by their module names only."""
