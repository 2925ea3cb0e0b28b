// What a page on the hub's origin does to reach the robot, with nothing but the browser's own WebRTC.
(async () => {
  const configuration = await (await fetch('/rosie/webrtc')).json();
  const connection = new RTCPeerConnection(configuration);
  const channel = connection.createDataChannel('robot');
  const open = new Promise((resolve, reject) => {
    channel.onopen = resolve;
    connection.onconnectionstatechange = () => {
      if (connection.connectionState === 'failed') reject(new Error('no path was found'));
    };
    setTimeout(() => reject(new Error('no path was found within 40 s')), 40000);
  });
  try {
    await connection.setLocalDescription();
    await new Promise((resolve) => {
      connection.onicegatheringstatechange = () => connection.iceGatheringState === 'complete' && resolve();
    });
    const answer = await fetch('/rosie/webrtc', {
      method: 'POST', headers: { 'Content-Type': 'application/sdp' }, body: connection.localDescription.sdp,
    });
    if (answer.status !== 201) throw new Error(await answer.text());
    await connection.setRemoteDescription({ type: 'answer', sdp: await answer.text() });
    await open;
    const called = new Promise((resolve) => { channel.onmessage = (event) => resolve(JSON.parse(event.data)); });
    channel.send(JSON.stringify({ op: 'call_service', service: '/beep' }));
    const { values } = await called;
    if (values.message !== 'here') throw new Error(JSON.stringify(values));
    const stats = await connection.getStats();
    const { selectedCandidatePairId } = [...stats.values()].find((each) => each.type === 'transport');
    const pair = stats.get(selectedCandidatePairId);
    const ends = [stats.get(pair.localCandidateId), stats.get(pair.remoteCandidateId)];
    const kinds = ends.map((each) => each.candidateType);
    const found = kinds.includes('relay') ? 'by a relay (TURN)'
      : kinds.some((kind) => kind !== 'host') ? 'through a NAT (STUN)' : 'directly';
    const [local, remote] = ends.map((each) => `${each.candidateType} ${each.address || 'hidden'}:${each.port}`);
    return { way: `${found}: ${local} to ${remote}` };
  } catch (error) {
    return { way: '', why: error.message };
  } finally {
    connection.close();
  }
})()
