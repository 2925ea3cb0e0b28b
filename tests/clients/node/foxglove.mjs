// Foxglove's own client (@foxglove/ws-protocol), with the readers and writers of messages that its viewers use.
// Every operation of the client is in one of the scenarios.

import { parse } from '@foxglove/rosmsg';
import { MessageReader as Reader1, MessageWriter as Writer1 } from '@foxglove/rosmsg-serialization';
import { MessageReader as Reader2, MessageWriter as Writer2 } from '@foxglove/rosmsg2-serialization';
import protocol from '@foxglove/ws-protocol';
import WebSocket from 'ws';

import { runProgram } from './program.mjs';

const { FoxgloveClient, StatusLevel } = protocol;
const EVENTS = [
  'serverInfo', 'status', 'removeStatus', 'message', 'time', 'advertise', 'unadvertise', 'advertiseServices',
  'unadvertiseServices', 'parameterValues', 'serviceCallResponse', 'connectionGraphUpdate', 'fetchAssetResponse',
  'serviceCallFailure', 'error',
];

// A client with what it has heard of each kind.
class Viewer {
  constructor(url) {
    this.client = new FoxgloveClient({ ws: new WebSocket(url, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
    this.heard = Object.fromEntries(EVENTS.map((event) => [event, []]));
    this.waiting = [];
    for (const event of EVENTS) {
      this.client.on(event, (said) => {
        this.heard[event].push(said);
        this.waiting.splice(0).forEach((look) => look());
      });
    }
  }

  // What `find` finds in what was heard of a kind, now or later.
  async find(event, find) {
    for (;;) {
      const found = this.heard[event].map(find).find((each) => each !== undefined);
      if (found !== undefined) return found;
      await new Promise((resolve) => this.waiting.push(resolve));
    }
  }

  channel(topic) {
    return this.find('advertise', (channels) => channels.find((channel) => channel.topic === topic));
  }

  service(name) {
    return this.find('advertiseServices', (services) => services.find((service) => service.name === name));
  }

  // The next message of a topic, read by its schema.
  async message(topic) {
    const channel = await this.channel(topic);
    const id = this.client.subscribe(channel.id);
    const message = await this.find('message', (each) => (each.subscriptionId === id ? each : undefined));
    this.client.unsubscribe(id);
    return { channel, message, value: read(channel, message.data) };
  }
}

function definitions({ schema, schemaEncoding }) {
  return parse(schema, { ros2: schemaEncoding === 'ros2msg' });
}

function read(described, data) {
  const Reader = described.encoding === 'cdr' ? Reader2 : Reader1;
  return new Reader(definitions(described)).readMessage(data);
}

function write(described, value) {
  const Writer = described.encoding === 'cdr' ? Writer2 : Writer1;
  return new Writer(definitions(described)).writeMessage(value);
}

async function using({ url }, use) {
  const viewer = new Viewer(url);
  try {
    await viewer.find('serverInfo', (info) => info);
    return await use(viewer);
  } finally {
    viewer.client.close();
  }
}

const text = (value) => new TextEncoder().encode(JSON.stringify(value));
const asText = (data) => new TextDecoder().decode(data);

const scenarios = {
  info: (robot) => using(robot, (viewer) => viewer.find('serverInfo', (info) => info)),

  // An image, a cloud, transforms and a pose, as their readers see them.
  messages: (robot) => using(robot, async (viewer) => {
    const [image, cloud, tf, odom, description] = await Promise.all(
      ['/camera/image_raw', '/camera/depth/points', '/tf', '/odom', '/robot_description'].map((topic) => viewer.message(topic)),
    );
    return {
      image: [image.value.width, image.value.height, image.value.encoding, image.value.data.length === image.value.step * image.value.height],
      cloud: [cloud.value.fields.map((field) => field.name), cloud.value.data.length === cloud.value.row_step * cloud.value.height],
      tf: tf.value.transforms.map((each) => [each.header.frame_id, each.child_frame_id]),
      odom: [odom.value.header.frame_id, odom.value.child_frame_id, odom.value.pose.covariance.length],
      description: description.value.data.slice(0, 30),
      stamped: Number(odom.message.timestamp / 1_000_000_000n) > 1_700_000_000,
      encodings: [odom.channel.encoding, odom.channel.schemaEncoding, odom.channel.schemaName],
    };
  }),

  // What is published in the robot's encoding and in JSON comes back; then its channel is taken back.
  publish: (robot) => using(robot, async (viewer) => {
    const { supportedEncodings } = await viewer.find('serverInfo', (info) => info);
    const [encoding] = supportedEncodings;
    const schema = { schema: 'string data\n', schemaEncoding: encoding === 'cdr' ? 'ros2msg' : 'ros1msg' };
    const topic = `/foxglove_words_${encoding}`;
    const own = viewer.client.advertise({ topic, encoding, schemaName: 'std_msgs/String', ...schema });
    const json = viewer.client.advertise({ topic, encoding: 'json', schemaName: 'std_msgs/String' });
    const channel = await viewer.channel(topic);
    const id = viewer.client.subscribe(channel.id);
    const heard = [];
    for (const [sender, data] of [[own, write({ encoding, ...schema }, { data: 'serialised' })], [json, text({ data: 'text' })]]) {
      viewer.client.sendMessage(sender, data);
      heard.push(await viewer.find('message', (each) => {
        const value = each.subscriptionId === id ? read(channel, each.data).data : undefined;
        return heard.includes(value) ? undefined : value;
      }));
    }
    viewer.client.unadvertise(own);
    viewer.client.sendMessage(own, text({ data: 'too late' }));
    const status = await viewer.find('status', (each) => each);
    return { heard, refused: [status.level === StatusLevel.ERROR, status.message] };
  }),

  call: (robot) => using(robot, async (viewer) => {
    const service = await viewer.service('/add_two_ints');
    const answer = (callId) => viewer.find('serviceCallResponse', (each) => (each.callId === callId ? each : undefined));
    viewer.client.sendServiceCallRequest({
      serviceId: service.id, callId: 1, encoding: 'json', data: text({ a: 1, b: 2 }),
    });
    viewer.client.sendServiceCallRequest({
      serviceId: service.id, callId: 2, encoding: service.request.encoding, data: write(service.request, { a: 40n, b: 2n }),
    });
    viewer.client.sendServiceCallRequest({ serviceId: 4_000_000_000, callId: 3, encoding: 'json', data: text({}) });
    const failure = await viewer.find('serviceCallFailure', (each) => each);
    return {
      json: JSON.parse(asText((await answer(1)).data)),
      serialised: String(read(service.response, (await answer(2)).data).sum),
      failure: [failure.callId, failure.message],
      type: service.type,
    };
  }),

  parameters: (robot) => using(robot, async (viewer) => {
    const { client } = viewer;
    const values = (id) => viewer.find('parameterValues', (each) => (each.id === id ? each.parameters : undefined));
    client.getParameters([], 'all');
    const all = (await values('all')).map(({ name }) => name);
    const name = all.find((each) => each.includes('camera_rate'));
    client.subscribeParameterUpdates([name]);
    client.setParameters([{ name, value: 25, type: 'float64' }], 'set');
    const set = await values('set');
    const [told] = await values(undefined);
    client.unsubscribeParameterUpdates([name]);
    client.setParameters([{ name, value: 30, type: 'float64' }], 'back');
    await values('back');
    client.getParameters([name], 'one');
    return { many: all.length > 5, name, set, told, one: await values('one') };
  }),

  graph: (robot) => using(robot, async (viewer) => {
    viewer.client.subscribeConnectionGraph();
    const graph = await viewer.find('connectionGraphUpdate', (each) => each);
    viewer.client.unsubscribeConnectionGraph();
    const named = (list, name) => list.find((each) => each.name === name);
    return [
      named(graph.publishedTopics, '/odom').publisherIds,
      named(graph.subscribedTopics, '/cmd_vel').subscriberIds.length > 0,
      named(graph.advertisedServices, '/add_two_ints').providerIds.length,
    ];
  }),

  // The mesh that the robot's description names, and one that does not exist.
  assets: (robot) => using(robot, async (viewer) => {
    const description = (await viewer.message('/robot_description')).value.data;
    const uri = /package:\/\/[^"]+/.exec(description)[0];
    viewer.client.fetchAsset(uri, 1);
    viewer.client.fetchAsset('package://none/none.dae', 2);
    const answer = (id) => viewer.find('fetchAssetResponse', (each) => (each.requestId === id ? each : undefined));
    const [mesh, none] = await Promise.all([answer(1), answer(2)]);
    return { mesh: asText(mesh.data).includes('<COLLADA'), none: [none.status, none.error.length > 10] };
  }),
};

await runProgram({}, scenarios);
