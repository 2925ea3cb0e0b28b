"""Sound to the robot and back by WebRTC in Chromium: a tone of its own, sent by WHIP and heard by WHEP."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Server
from tests.browser.driver import IS_MUTE, MUTE, Browser
from tests.browser.stand import stand
from tests.browser.test_panels import violations
from tests.waiting import until
from tests.webrtc.sounds import TONE

pytestmark = pytest.mark.anyio

WATCHER = "a-watcher-s-token-0123456789"
DEAF = "a-deaf-one-s-token-0123456789"


def _http(server: Server) -> str:
    return server.urls[0].replace("ws", "http", 1) + "/"


SIGNAL = """
window.context = new AudioContext();
window.signal = async (connection, address) => {
  await connection.setLocalDescription();
  const answer = await fetch(address, {
    method: "POST", headers: { "Content-Type": "application/sdp" }, body: connection.localDescription.sdp,
  });
  if (!answer.ok) throw new Error(await answer.text());
  await connection.setRemoteDescription({ type: "answer", sdp: await answer.text() });
};
void 0
"""
SEND = """
(async () => {
  const tone = new OscillatorNode(context, { frequency: %d });
  const out = context.createMediaStreamDestination();
  tone.connect(out);
  tone.start();
  window.sending = new RTCPeerConnection();
  sending.addTrack(out.stream.getAudioTracks()[0], out.stream);
  await signal(sending, "/whip?audio=/operator/voice");
  return context.state;
})()
"""
HEAR = """
(async () => {
  window.hearing = new RTCPeerConnection();
  hearing.addTransceiver("audio", { direction: "recvonly" });
  window.analyser = new AnalyserNode(context, { fftSize: 8192 });
  hearing.ontrack = ({ track }) => {
    const stream = new MediaStream([track]);
    // Chromium decodes what an element has.
    window.element = Object.assign(new Audio(), { srcObject: stream, muted: true });
    element.play();
    context.createMediaStreamSource(stream).connect(analyser);
  };
  await signal(hearing, "/whep?audio=/operator/voice");
})()
"""
PITCH = """
(() => {
  const loud = new Float32Array(analyser.frequencyBinCount);
  analyser.getFloatFrequencyData(loud);
  const peak = loud.indexOf(Math.max(...loud));
  return loud[peak] > -60 && Math.abs(peak * context.sampleRate / 8192 - %d) < 15;
})()
"""


@pytest.mark.skipif(IS_MUTE, reason=MUTE)
async def test_a_tone_goes_to_the_robot_and_comes_back(browser: Browser) -> None:
    async with stand("jazzy", browser.built, robot=False, webrtc=True) as where:
        pieces: list[Any] = []
        where.node.subscribe("/operator/voice", pieces.append, "audio_common_msgs/AudioData")
        async with browser.page(f"{where.url}web/pages/battery.html") as page:
            await page.evaluate(SIGNAL)
            await page.evaluate(SEND % TONE)
            await until(lambda: len(pieces) > 5)
            await page.evaluate(HEAR)
            await page.wait(PITCH % TONE)


async def test_who_is_heard_is_seen_by_everybody_while_it_lasts(browser: Browser) -> None:
    """The page of somebody else has a light, and none of a role that may not know."""
    tokens = {"watcher": {"token": WATCHER, "role": "watcher"}, "deaf": {"token": DEAF, "role": "deaf"}}
    settings: dict[str, Any] = {
        "auth": {"tokens": tokens, "default_role": "admin"},
        "roles": {"watcher": {"subscribe": ["*"]}, "deaf": {"subscribe": ["/odom"]}},
        "webrtc": {"enabled": True},
    }
    lights = "[...document.querySelectorAll('.senders p')].map((each) => each.textContent)"
    async with (
        Server("ws://127.0.0.1:0", **settings) as server,
        browser.page(f"{_http(server)}web/pages/battery.html") as operator,
        browser.page(f"{_http(server)}healthz") as watcher,
        browser.page(f"{_http(server)}healthz") as deaf,
    ):
        for page, role, token in ((watcher, "watcher", WATCHER), (deaf, "deaf", DEAF)):
            await page.evaluate(f"sessionStorage.setItem('rwt-token {server.urls[0]}/', '{token}')")
            await page.goto(_http(server))
            await page.wait(f"document.querySelector('.fact.role')?.textContent.includes('{role}')")
        await operator.evaluate(SIGNAL)
        await operator.evaluate(SEND % TONE)
        await watcher.wait(f"{lights}.length === 1")
        (light,) = await watcher.evaluate(lights)
        assert light.startswith("Microphone on: whip:1 (admin) sends /operator/voice since ")
        assert await violations(watcher) == []
        await watcher.picture("microphone on")
        assert await deaf.evaluate(lights) == []
        await operator.evaluate("sending.close()")
        await watcher.wait(f"{lights}.length === 0")
