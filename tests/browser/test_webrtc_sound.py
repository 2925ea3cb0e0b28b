"""Sound to the robot and back by WebRTC in Chromium: a tone of its own, sent by WHIP and heard by WHEP."""

from __future__ import annotations

from typing import Any

import pytest

from tests.browser.driver import Browser, until
from tests.browser.stand import stand
from tests.webrtc.sounds import TONE

pytestmark = pytest.mark.anyio

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
