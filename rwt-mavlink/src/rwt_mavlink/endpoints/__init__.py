"""Topics and services of one vehicle in the graph, with the names and types of mavros."""
