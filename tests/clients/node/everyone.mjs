// A client among others: `node everyone.mjs roslib|foxglove URL`. Reads "TOPIC WORD" by the line and publishes the word
// there, and prints by the line what it heard and what it was refused, as JSON.

import readline from 'node:readline';

const WORDS = '/words';
const [kind, url] = process.argv.slice(2);
const say = (event) => process.stdout.write(`${JSON.stringify(event)}\n`);

// As its users write it: a string as it is, a speed as that of a Twist.
const messageOf = (topic, word) => (topic === WORDS ? { data: word } : { linear: { x: Number(word) } });
const typeOf = (topic) => (topic === WORDS ? 'std_msgs/String' : 'geometry_msgs/Twist');

async function roslib() {
  const ROSLIB = await import('roslib');
  const ros = new ROSLIB.Ros({});
  const connected = new Promise((resolve) => ros.once('connection', resolve));
  ros.connect(url);
  await connected;
  // roslib's own event is called `status:ID`, with the id of each message that it is about.
  ros.transport.on('message', ({ op, level, msg }) => op === 'status' && say({ [level === 'error' ? 'refused' : 'status']: msg }));
  ros.setStatusLevel('warning');
  new ROSLIB.Topic({ ros, name: WORDS, messageType: typeOf(WORDS) }).subscribe(({ data }) => say({ heard: data }));
  return (name, word) => new ROSLIB.Topic({ ros, name, messageType: typeOf(name) }).publish(messageOf(name, word));
}

async function foxglove() {
  const { parse } = await import('@foxglove/rosmsg');
  const { MessageReader } = await import('@foxglove/rosmsg2-serialization');
  const { FoxgloveClient, StatusLevel } = (await import('@foxglove/ws-protocol')).default;
  const { default: WebSocket } = await import('ws');
  const client = new FoxgloveClient({ ws: new WebSocket(url, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
  const readers = new Map();
  const greeted = new Promise((resolve) => client.on('serverInfo', resolve));
  client.on('advertise', (channels) => {
    for (const { id, topic, schema } of channels) {
      if (topic === WORDS) readers.set(client.subscribe(id), new MessageReader(parse(schema, { ros2: true })));
    }
  });
  client.on('message', ({ subscriptionId, data }) => say({ heard: readers.get(subscriptionId).readMessage(data).data }));
  client.on('status', ({ level, message }) => say({ [level === StatusLevel.ERROR ? 'refused' : 'status']: message }));
  await greeted;
  const channels = new Map();
  return (topic, word) => {
    if (!channels.has(topic)) channels.set(topic, client.advertise({ topic, encoding: 'json', schemaName: typeOf(topic) }));
    client.sendMessage(channels.get(topic), new TextEncoder().encode(JSON.stringify(messageOf(topic, word))));
  };
}

const publish = await { roslib, foxglove }[kind]();
say({ ready: true });
for await (const line of readline.createInterface({ input: process.stdin })) {
  const [topic, word] = line.split(' ');
  publish(topic, word);
}
process.exit(0);
