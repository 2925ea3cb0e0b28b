"""What a server tells about itself: metrics, in the text format of Prometheus."""
