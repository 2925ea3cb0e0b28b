// What the test pages share: the connection, and words of the page's address.

const asked = new URLSearchParams(location.search);
const ros = new ROSLIB.Ros({ url: `ws://${location.host}` });
const state = { connected: false };

ros.on('connection', () => { state.connected = true; });
ros.on('error', (error) => console.error('ros', error));
