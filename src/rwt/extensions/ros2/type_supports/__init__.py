"""Type supports of ROS 2 made from definitions, and the endpoints of services that use them."""
