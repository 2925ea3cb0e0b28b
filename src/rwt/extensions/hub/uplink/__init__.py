"""Uplink: one WebSocket of a robot to a hub, which carries streams for clients and pages.

* :mod:`.frames`: the frames on the wire.
* :mod:`.window`: how many bytes may be under way.
* :mod:`.streams`: one client or page, as a sink and its flow control.
* :mod:`.uplink`: the streams of one robot, in classes of priority, resumed after a short loss.
* :mod:`.carrier`: the WebSocket below.
* :mod:`.openings`, :mod:`.pages`: how a stream begins, and HTTP over one.
* :mod:`.dial`: the robot's side. The hub's is :mod:`rwt.extensions.hub.hub`.
"""
