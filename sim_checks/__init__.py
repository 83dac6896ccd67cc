"""Physics checks of an exported twin."""
