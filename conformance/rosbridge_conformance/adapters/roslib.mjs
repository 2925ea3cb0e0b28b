// Puts roslib (1.x or 2.x) under the rosbridge conformance suite. Node 20 or later, no other packages.
//
//   rosbridge-conformance client --target roslib-2 -- node roslib.mjs [FOLDER [PACKAGE]]
//
// FOLDER has the node_modules (default: the working directory), PACKAGE is the package's name there (roslib).
// Commands come as JSON lines on standard input; answers and events go to standard output.

import { readFileSync } from 'node:fs';
import path from 'node:path';
import readline from 'node:readline';
import { pathToFileURL } from 'node:url';

const [folder = '.', packageName = 'roslib'] = process.argv.slice(2);
const home = path.resolve(folder, 'node_modules', packageName);
const manifest = JSON.parse(readFileSync(path.join(home, 'package.json'), 'utf8'));
const entry = manifest.exports?.['.']?.import ?? manifest.main;

const say = (line) => process.stdout.write(`${JSON.stringify(line, plain)}\n`);
const complain = (...words) => say({ event: 'complaint', text: words.map(String).join(' ') });
console.log = console.info = console.warn = console.error = complain;
// A browser goes on after these, a program on Node ends unless it has such handlers.
const confess = (error) => say({ event: 'uncaught', text: String(error) });
process.on('uncaughtException', confess);
process.on('unhandledRejection', confess);

const loaded = await import(pathToFileURL(path.join(home, entry)).href);
const ROSLIB = loaded.Ros ? loaded : loaded.default;
const modern = !ROSLIB.Message;

// Octets and other typed arrays are lists of numbers on the way out, and so are the bytes of cbor-raw.
function plain(_, value) {
  if (typeof value === 'bigint') return Number(value);
  return ArrayBuffer.isView(value) ? Array.from(value) : value;
}

let ros;
const made = new Map();

class Unsupported extends Error {}

const event = (name, of, more) => say({ event: name, of, ...more });
const message = (values) => (modern ? values : new ROSLIB.Message(values));
const request = (values = {}) => (modern ? values : new ROSLIB.ServiceRequest(values));
const topicOf = ({ topic, type, ...more }) => {
  const { as, do: _, n, ...options } = more;
  for (const name of ['fragment_size', 'qos']) {
    if (name in options) throw new Unsupported(`topics have no option ${name}`);
  }
  return new ROSLIB.Topic({ ros, name: topic, messageType: type, ...options });
};
const service = (name, serviceType) => new ROSLIB.Service({ ros, name, serviceType });
const action = (name, actionType) => {
  if (!ROSLIB.Action) throw new Unsupported('no actions of ROS 2');
  return new ROSLIB.Action({ ros, name, actionType });
};
const tellsResponse = (as) => [
  (value) => event('response', as, { value: value ?? null }),
  (error) => event('failed', as, { error: error ?? null }),
];

function opened(url, wait) {
  ros = new ROSLIB.Ros(modern ? {} : { encoding: 'utf8' });
  made.clear();
  ros.on('error', (error) => complain(error?.message ?? error));
  ros.on('close', () => say({ event: 'closed' }));
  for (const id of ['status', 'status:mine']) {
    ros.on(id, ({ level, msg }) => say({ event: 'status', level, msg, id: id.split(':')[1] ?? null }));
  }
  return joined(url, wait);
}

function joined(url, wait = true) {
  const open = new Promise((resolve) => ros.once('connection', resolve));
  ros.connect(url);
  return wait ? open : undefined;
}

function left() {
  if (!ros?.isConnected) return undefined;
  const closed = new Promise((resolve) => ros.once('close', resolve));
  ros.close();
  return closed;
}

function answering(as, answer = {}) {
  return (args, response) => {
    event('request', as, { value: args });
    if (answer.throw) throw new Error(answer.throw);
    Object.assign(response, answer.values);
    return answer.result ?? true;
  };
}

// What rosapi is asked, by the names of the line protocol.
const questions = {
  topics: (...done) => ros.getTopics(({ topics }) => done[0](topics), done[1]),
  topic_type: (...done) => ros.getTopicType(done.pop(), ...done),
  topics_for_type: (...done) => ros.getTopicsForType(done.pop(), ...done),
  services: (...done) => ros.getServices(...done),
  service_type: (...done) => ros.getServiceType(done.pop(), ...done),
  services_for_type: (...done) => ros.getServicesForType(done.pop(), ...done),
  nodes: (...done) => ros.getNodes(...done),
  params: (...done) => ros.getParams(...done),
  action_servers: (...done) => ros.getActionServers(...done),
  message_details: (...done) => ros.getMessageDetails(done.pop(), ...done),
};

const commands = {
  connect: ({ url, wait }) => opened(url, wait),
  // It does not come back by itself, and cannot before it knows that the connection is lost.
  async reconnect({ url }) {
    if (ros.isConnected) await new Promise((resolve) => ros.once('close', resolve));
    await joined(url);
  },
  close: left,

  subscribe(command) {
    const topic = topicOf(command);
    made.set(command.as, topic);
    topic.subscribe((value) => event('message', command.as, { value }));
  },
  unsubscribe: ({ of }) => made.get(of).unsubscribe(),
  advertise(command) {
    made.set(command.as, topicOf(command));
    made.get(command.as).advertise();
  },
  unadvertise: ({ of }) => made.get(of).unadvertise(),
  publish({ of, topic, type, msg }) {
    (of ? made.get(of) : topicOf({ topic, type })).publish(message(msg));
  },

  call_service({ as, service: name, type, args, timeout, fragment_size }) {
    if (fragment_size) throw new Unsupported('calls have no option fragment_size');
    if (timeout && !modern) throw new Unsupported('calls have no timeout');
    service(name, type).callService(request(args), ...tellsResponse(as), timeout);
  },
  advertise_service({ as, service: name, type, answer }) {
    made.set(as, service(name, type));
    return made.get(as).advertise(answering(as, answer));
  },
  unadvertise_service: ({ of }) => made.get(of).unadvertise(),

  send_goal({ as, action: name, type, args, feedback }) {
    if (feedback === false) throw new Unsupported('goals always ask for feedback');
    const client = action(name, type);
    const id = client.sendGoal(
      args,
      (value) => event('result', as, { value, status: 4 }),
      (value) => event('feedback', as, { value }),
      (error) => event('failed', as, { error: error ?? null }),
    );
    made.set(as, { cancel: () => client.cancelGoal(id) });
  },
  cancel_goal: ({ of }) => made.get(of).cancel(),
  advertise_action({ as, action: name, type, answer = {} }) {
    const provider = action(name, type);
    made.set(as, provider);
    provider.advertise(
      (value, id) => {
        event('goal', as, { value });
        for (const feedback of answer.feedback ?? []) provider.sendFeedback(id, feedback);
        if (answer.end === 'abort') provider.setFailed(id);
        else if (answer.end !== 'wait') provider.setSucceeded(id, answer.values);
      },
      (id) => {
        event('cancel', as);
        provider.setCanceled(id, answer.values);
      },
    );
  },
  unadvertise_action: ({ of }) => made.get(of).unadvertise(),

  actionlib_goal({ as, server, type, goal: values }) {
    const client = new ROSLIB.ActionClient({ ros, serverName: server, actionName: type });
    const goal = new ROSLIB.Goal({ actionClient: client, goalMessage: values });
    goal.on('feedback', (value) => event('feedback', as, { value }));
    goal.on('result', (value) => event('result', as, { value, status: goal.status.status }));
    made.set(as, goal);
    goal.send();
  },
  actionlib_cancel: ({ of }) => made.get(of).cancel(),
  actionlib_serve({ as, server: name, type, answer = {} }) {
    const server = new ROSLIB.SimpleActionServer({ ros, serverName: name, actionName: type });
    server.on('goal', (value) => {
      event('goal', as, { value });
      for (const feedback of answer.feedback ?? []) server.sendFeedback(feedback);
      if (answer.end === 'abort') server.setAborted(answer.values);
      else if (answer.end !== 'wait') server.setSucceeded(answer.values);
    });
    server.on('cancel', () => {
      event('cancel', as);
      server.setPreempted();
    });
  },

  tf_subscribe({ as, fixed_frame: fixedFrame, frame }) {
    const client = new ROSLIB.TFClient({ ros, fixedFrame });
    client.subscribe(frame, (value) => event('transform', as, { value }));
  },

  get_param: ({ as, name }) => new ROSLIB.Param({ ros, name }).get(...tellsResponse(as)),
  set_param: ({ as, name, value }) => new ROSLIB.Param({ ros, name }).set(value, ...tellsResponse(as)),
  delete_param: ({ as, name }) => new ROSLIB.Param({ ros, name }).delete(...tellsResponse(as)),
  ask({ as, what, of_what }) {
    if (!(what in questions)) throw new Unsupported(`no question ${what}`);
    questions[what](...tellsResponse(as), ...(of_what === undefined ? [] : [of_what]));
  },

  set_level: ({ level, id }) => ros.setStatusLevel(level, id),
  authenticate: ({ mac, client, dest, rand, t, level, end }) =>
    ros.authenticate(mac, client, dest, rand, t, level, end),
};

async function answer(command) {
  try {
    if (!(command.do in commands)) throw new Unsupported(`no command ${command.do}`);
    await commands[command.do](command);
    return { ok: true };
  } catch (error) {
    return error instanceof Unsupported ? { unsupported: error.message } : { error: String(error?.stack ?? error) };
  }
}

say({ event: 'ready', library: 'roslib', version: manifest.version });
for await (const line of readline.createInterface({ input: process.stdin })) {
  const command = JSON.parse(line);
  say({ n: command.n, ...(await answer(command)) });
}
process.exit(0);
