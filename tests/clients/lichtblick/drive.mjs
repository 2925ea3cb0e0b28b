// Lichtblick's own player, as its panels use it, in Node: `node drive.mjs PLAYER.mjs URL`. Prints what it came to know.

import { pathToFileURL } from 'node:url';
import WebSocket from 'ws';

// Where there is no Worker, the player opens the WebSocket itself; browsers and newer Nodes have one.
globalThis.WebSocket = WebSocket;
for (const level of ['debug', 'info', 'log']) console[level] = () => {};

const [player_file, url] = process.argv.slice(2);
const { default: Player } = await import(pathToFileURL(player_file));
const counted = new Proxy({}, { get: () => () => {} });
const player = new Player({ url, metricsCollector: counted, sourceId: 'foxglove-websocket' });

let latest;
const messages = new Map();
let waiting = [];
player.setListener(async (state) => {
  latest = state;
  for (const message of state.activeData?.messages ?? []) messages.set(message.topic, message);
  for (const look of waiting.splice(0)) look();
});

async function until(what, find) {
  const gives_up = Date.now() + 25_000;
  for (;;) {
    const found = latest && find(latest);
    if (found) return found;
    if (Date.now() > gives_up) throw new Error(`no ${what}: ${JSON.stringify(latest?.alerts)}`);
    await Promise.race([
      new Promise((resolve) => waiting.push(resolve)),
      new Promise((resolve) => setTimeout(resolve, 100)),
    ]);
  }
}

const data = (state) => state.activeData ?? {};
const WANTED = ['/camera/image_raw', '/camera/depth/points', '/tf', '/odom', '/robot_description', '/cmd_vel'];
await until('topics', (state) => WANTED.every((topic) => data(state).topics?.some((each) => each.name === topic)));
player.setSubscriptions(WANTED.map((topic) => ({ topic })));
const heard = (topic) => until(topic, () => messages.get(topic)?.message);

const image = await heard('/camera/image_raw');
const cloud = await heard('/camera/depth/points');
const tf = await heard('/tf');
const odom = await heard('/odom');
const description = (await heard('/robot_description')).data;

player.setPublishers([{ topic: '/cmd_vel', schemaName: 'geometry_msgs/msg/Twist', options: {
  datatypes: data(latest).datatypes } }]);
player.publish({ topic: '/cmd_vel', msg: { linear: { x: 0.1, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0.25 } } });
const twist = await until('the twist', () => messages.get('/cmd_vel')?.message);

const sum = await player.callService('/add_two_ints', { a: 1n, b: 2n });
const failure = await player.callService('/none', {}).catch((error) => error.message);

const name = await until('parameters', (state) => [...(data(state).parameters?.keys() ?? [])].find((each) => each.includes('camera_rate')));
player.setParameter(name, 21);
await until('the parameter', (state) => data(state).parameters.get(name) === 21);

const mesh = await player.fetchAsset(/package:\/\/[^"]+/.exec(description)[0]);
const missing = await player.fetchAsset('package://none/none.dae').catch((error) => error.message);
const graph = await until('the graph', (state) => data(state).publishedTopics?.get('/odom'));

console.warn = console.error = () => {};
process.stdout.write(JSON.stringify({
  presence: latest.presence,
  capabilities: latest.capabilities,
  profile: latest.profile,
  image: [image.width > 100, image.data.length === image.step * image.height],
  cloud: cloud.data.length === cloud.row_step * cloud.height,
  tf: tf.transforms.length > 0,
  odom: [odom.child_frame_id, odom.pose.covariance.length],
  twist: [twist.linear.x, twist.angular.z],
  sum: String(sum.sum),
  failure,
  mesh: new TextDecoder().decode(mesh.data).includes('<COLLADA'),
  missing: missing.length > 10,
  graph: [...graph],
  services: data(latest).services.has('/add_two_ints'),
  alerts: latest.alerts ?? [],
}) + "\n");
player.close();
process.exit(0);
