"""The live panel: what is shown and what may be asked. ROS is in `pzt_nodes.panel_node`, the page in `page.py`."""
