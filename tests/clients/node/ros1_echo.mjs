// roslib 2.1.0 on a ROS 1 robot: `ros1_echo.mjs URL`, see tests/extensions/ros1/live/echo_roslibpy.py.

import { createInterface } from 'node:readline';

import * as ROSLIB from 'roslib';

const ros = new ROSLIB.Ros({ url: process.argv[2] });
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const listed = () => new Promise((done, failed) => ros.getTopics((found) => done(found), failed));

createInterface({ input: process.stdin }).once('line', async (line) => {
  const types = JSON.parse(line);
  while (true) {
    const { topics, types: names } = await listed();
    const known = new Map(topics.map((topic, index) => [topic, names[index]]));
    if (Object.entries(types).every(([topic, type]) => known.get(topic) === type)) break;
    await pause(200);
  }
  const received = {};
  for (const [name, messageType] of Object.entries(types)) {
    const topic = new ROSLIB.Topic({ ros, name, messageType });
    let back;
    if (name.startsWith('/from/')) {
      back = new ROSLIB.Topic({ ros, name: name.replace('/from/', '/back/'), messageType, latch: true });
      back.advertise();
    }
    topic.subscribe((message) => {
      received[name] = message;
      back?.publish(message);
      if (Object.keys(received).length === Object.keys(types).length) {
        process.stdout.write(`${JSON.stringify(received)}\n`);
      }
    });
  }
});
