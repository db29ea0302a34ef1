"""Data about the graph, no behaviour: topics, QoS, processes' parameters, chains and scenarios."""
