"""GStreamer's webrtcbin as a viewer or a camera: `/usr/bin/python3 gstreamer_peer.py whep|whip URL`.

Runs on the system's Python, which has Debian's bindings, and imports nothing of this project. Prints the
median colour of each picture that comes, and `connected` once a camera's peer is.
"""

import sys
import urllib.request
from typing import Any

import gi  # type: ignore[import-not-found]  # installed for the system's Python only

gi.require_version("Gst", "1.0")
gi.require_version("GstSdp", "1.0")
gi.require_version("GstWebRTC", "1.0")
from gi.repository import GLib, Gst, GstSdp, GstWebRTC  # type: ignore[import-not-found] # noqa: E402 - the same; versions are set first

RTP = "application/x-rtp,media=video,encoding-name=VP8,payload=96,clock-rate=90000"
SEEN = (
    "rtpvp8depay ! vp8dec ! videoconvert ! video/x-raw,format=RGB"
    " ! appsink name=seen emit-signals=true max-buffers=1 drop=true sync=false"
)
CAMERA = (
    "videotestsrc is-live=true pattern=solid-color foreground-color=0xffc81e1e"
    " ! video/x-raw,width=64,height=48,framerate=20/1 ! videoconvert ! vp8enc deadline=1 keyframe-max-dist=20"
    f" ! rtpvp8pay ! {RTP} ! webrtcbin name=peer bundle-policy=max-bundle"
)


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def on_sample(sink: Any) -> Any:
    buffer = sink.emit("pull-sample").get_buffer()
    data = buffer.extract_dup(0, buffer.get_size())
    say("colour", *(sorted(data[at::3])[len(data) // 6] for at in range(3)))
    return Gst.FlowReturn.OK


def on_pad(peer: Any, pad: Any, pipeline: Any) -> None:
    if pad.direction != Gst.PadDirection.SRC:
        return
    shown = Gst.parse_bin_from_description(SEEN, True)
    shown.get_by_name("seen").connect("new-sample", on_sample)
    pipeline.add(shown)
    shown.sync_state_with_parent()
    pad.link(shown.get_static_pad("sink"))


def on_gathered(peer: Any, _: object, url: str) -> None:
    """The offer is complete: send it, and take the answer."""
    if peer.get_property("ice-gathering-state") != GstWebRTC.WebRTCICEGatheringState.COMPLETE:
        return
    text = peer.get_property("local-description").sdp.as_text()
    request = urllib.request.Request(url, text.encode(), {"Content-Type": "application/sdp"})
    with urllib.request.urlopen(request, timeout=60) as answer:
        body = answer.read()
    _, sdp = GstSdp.SDPMessage.new()
    GstSdp.sdp_message_parse_buffer(body, sdp)
    taken = GstWebRTC.WebRTCSessionDescription.new(GstWebRTC.WebRTCSDPType.ANSWER, sdp)
    peer.emit("set-remote-description", taken, None)


def on_state(peer: Any, _: object) -> None:
    if peer.get_property("connection-state") == GstWebRTC.WebRTCPeerConnectionState.CONNECTED:
        say("connected")


def on_offer(promise: Any, peer: Any) -> None:
    reply = promise.get_reply()  # What it holds is gone with it.
    peer.emit("set-local-description", reply.get_value("offer"), None)


def offer(peer: Any) -> None:
    peer.emit("create-offer", None, Gst.Promise.new_with_change_func(on_offer, peer))


def main(way: str, url: str) -> None:
    Gst.init(None)
    if way == "whip":
        pipeline = Gst.parse_launch(CAMERA)
        peer = pipeline.get_by_name("peer")
    else:
        pipeline = Gst.Pipeline.new()
        peer = Gst.ElementFactory.make("webrtcbin", "peer")
        peer.set_property("bundle-policy", GstWebRTC.WebRTCBundlePolicy.MAX_BUNDLE)
        pipeline.add(peer)
        direction = GstWebRTC.WebRTCRTPTransceiverDirection.RECVONLY
        peer.emit("add-transceiver", direction, Gst.Caps.from_string(RTP))
        peer.connect("pad-added", on_pad, pipeline)
    peer.connect("notify::ice-gathering-state", on_gathered, url)
    peer.connect("notify::connection-state", on_state)
    peer.connect("on-negotiation-needed", offer)
    pipeline.set_state(Gst.State.PLAYING)
    GLib.MainLoop().run()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
