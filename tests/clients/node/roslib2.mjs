// roslib 2.1.0 (ESM), as npm ships it.

import * as ROSLIB from 'roslib';

import { actionScenarios } from './actions.mjs';
import { actionlibScenarios } from './actionlib.mjs';
import { Asking } from './asking.mjs';
import { encodingScenarios } from './encodings.mjs';
import { introspectionScenarios } from './introspection.mjs';
import { pause, runProgram } from './program.mjs';
import { robotScenarios } from './robot.mjs';
import { serviceScenarios } from './services.mjs';
import { topicScenarios } from './topics.mjs';
import { transformScenarios } from './transforms.mjs';

const ADD = 'example_interfaces/AddTwoInts';

const library = { name: 'roslib2', ROSLIB, message: (values) => values, request: (values) => values };
const asking = new Asking(library);

async function provideAsync(connections, name, handler) {
  const provider = await connections.open();
  await asking.service(provider, `/roslib2/${name}`, ADD).advertiseAsync(handler);
  await asking.settled(provider);
  const caller = await connections.open();
  return (values, ...timeout) => asking.call(caller, `/roslib2/${name}`, ADD, values, ...timeout);
}

// What only this release has.
const only = {
  async provide_exception(connections) {
    const provider = await connections.open();
    await asking.service(provider, '/roslib2/throws', ADD).advertise(() => {
      throw new Error('no power');
    });
    await asking.settled(provider);
    return asking.call(await connections.open(), '/roslib2/throws', ADD, { a: 1 });
  },

  async provide_async(connections) {
    const call = await provideAsync(connections, 'later', async ({ a, b }) => {
      await pause(20);
      return { sum: a + b };
    });
    return call({ a: 3, b: 4 });
  },

  async provide_async_rejects(connections) {
    const call = await provideAsync(connections, 'rejects', async () => {
      throw new Error('no power');
    });
    return call({ a: 1 });
  },

  // Ten calls at once, answered in reverse order.
  async provide_in_any_order(connections) {
    const waiting = [];
    const call = await provideAsync(
      connections,
      'reverses',
      ({ a }) =>
        new Promise((resolve) => {
          waiting.push(() => resolve({ sum: a * 10 }));
          if (waiting.length === 10) waiting.reverse().forEach((answer) => answer());
        }),
    );
    return Promise.all(Array.from({ length: 10 }, (_, a) => call({ a })));
  },

  async call_times_out(connections) {
    const call = await provideAsync(connections, 'never', () => new Promise(() => {}));
    const start = performance.now();
    const answer = await call({}, 0.3);
    return { answer, seconds: (performance.now() - start) / 1000 };
  },

  async publishers(connections) {
    const ros = await connections.open();
    return {
      odom: await asking.ask(asking.topic(ros, '/odom', 'nav_msgs/Odometry'), 'getPublishers'),
      unknown: await asking.ask(asking.topic(ros, '/no_such_topic', 'std_msgs/String'), 'getPublishers'),
    };
  },
};

await runProgram(library, {
  ...topicScenarios(asking),
  ...serviceScenarios(asking),
  ...introspectionScenarios(asking),
  ...robotScenarios(asking),
  ...actionScenarios(asking),
  ...actionlibScenarios(asking),
  ...encodingScenarios(asking),
  ...transformScenarios(asking),
  ...only,
});
