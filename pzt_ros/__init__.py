"""Models, observers and controllers for piezo nanopositioning stages; imports no ROS."""

__version__ = "0.1.0"
