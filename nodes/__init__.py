"""The nodes of the graph: each a thin shell around one library object."""
