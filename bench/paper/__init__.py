"""Fig. 3 and the tables of "Robot Web Tools: Efficient Messaging for Cloud Robotics" (IROS 2015), done here.

Each has a module, and :data:`bench.paper.__main__.PARTS` has a row for each.
"""
