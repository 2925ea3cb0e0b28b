// Runs named scenarios against one server and prints what each observed, one JSON line per scenario.
// Usage: node roslib2.mjs URL [SCENARIO …]; without names they are read from standard input, one a line.
// A scenario may take one argument, separated by a space: "listen /words".
// Nothing is asserted here: the tests compare what is printed with what they expect.

import readline from 'node:readline';

const LIMIT_MS = 12_000;

// What the library complained about since the last scenario: default failure callbacks, 'error' events, exceptions.
const complaints = [];
console.error = (...words) => complaints.push(words.map(String).join(' '));
process.on('uncaughtException', (error) => complaints.push(String(error)));

// Everything one scenario opens, so that it is closed again whatever happens.
class Connections {
  constructor(library, url) {
    this.library = library;
    this.url = url;
    this.opened = [];
  }

  async open(options = {}) {
    const ros = new this.library.ROSLIB.Ros({ ...this.library.options, ...options });
    this.opened.push(ros);
    ros.on('error', (error) => complaints.push(String(error?.message ?? error)));
    await connect(ros, this.url);
    return ros;
  }

  async closeAll() {
    await Promise.all(this.opened.filter((ros) => ros.isConnected).map(disconnect));
  }
}

export function connect(ros, url) {
  const connected = next(ros, 'connection');
  ros.connect(url);
  return connected;
}

export function disconnect(ros) {
  const closed = next(ros, 'close');
  ros.close();
  return closed;
}

export function next(emitter, event) {
  return new Promise((resolve) => emitter.once(event, resolve));
}

export function pause(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

function outOfTime() {
  let timer;
  const expired = new Promise((_, reject) => {
    timer = setTimeout(() => reject(new Error(`nothing after ${LIMIT_MS} ms`)), LIMIT_MS);
  });
  return { expired, stop: () => clearTimeout(timer) };
}

async function observe(library, scenarios, url, line) {
  const [name, argument] = line.split(' ');
  const connections = new Connections(library, url);
  const limit = outOfTime();
  const report = { scenario: line };
  try {
    if (!(name in scenarios)) throw new Error(`no scenario is called ${name}`);
    report.observed = await Promise.race([scenarios[name](connections, argument), limit.expired]);
  } catch (error) {
    report.failed = String(error?.stack ?? error);
  } finally {
    limit.stop();
    await Promise.race([connections.closeAll(), pause(1000)]);
  }
  report.complaints = complaints.splice(0);
  return report;
}

export async function runProgram(library, scenarios) {
  const [url, ...names] = process.argv.slice(2);
  const lines = names.length > 0 ? names : readline.createInterface({ input: process.stdin });
  for await (const line of lines) {
    const report = await observe(library, scenarios, url, line);
    process.stdout.write(`${JSON.stringify(report)}\n`);
  }
  // A SimpleActionServer never stops its own status timer, so the program has to end itself.
  process.exit(0);
}
