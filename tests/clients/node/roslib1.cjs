// roslib 1.4.1 (CommonJS), as npm ships it.

const ROSLIB = require('roslib1');

const library = {
  name: 'roslib1',
  ROSLIB,
  // Without an encoding it warns on standard error that it takes this one.
  options: { encoding: 'utf8' },
  message: (values) => new ROSLIB.Message(values),
  request: (values) => new ROSLIB.ServiceRequest(values),
};

async function main() {
  const { actionlibScenarios } = await import('./actionlib.mjs');
  const { Asking } = await import('./asking.mjs');
  const { encodingScenarios } = await import('./encodings.mjs');
  const { introspectionScenarios } = await import('./introspection.mjs');
  const { runProgram } = await import('./program.mjs');
  const { robotScenarios } = await import('./robot.mjs');
  const { serviceScenarios } = await import('./services.mjs');
  const { topicScenarios } = await import('./topics.mjs');
  const { transformScenarios } = await import('./transforms.mjs');
  const asking = new Asking(library);

  // What only this release can observe: its emitter has wildcards, so the id of a refused frame need not be known.
  const only = {
    async status_after_set_level(connections) {
      const ros = await connections.open();
      const statuses = [];
      ros.onAny((event, value) => {
        if (String(event).startsWith('status')) statuses.push({ event, level: value.level, text: value.msg });
      });
      const topic = asking.topic(ros, '/roslib1/status', 'std_msgs/String');
      asking.publish(topic, { bogus: 1 });
      await asking.settled(ros);
      const before = statuses.splice(0);
      ros.setStatusLevel('error', 'mine');
      asking.publish(topic, { bogus: 1 });
      const refused = `status:publish:/roslib1/status:${ros.idCounter}`;
      await asking.settled(ros);
      ros.setStatusLevel('none', 'mine');
      const after = statuses.splice(0);
      asking.publish(topic, { bogus: 1 });
      await asking.settled(ros);
      return { before, after, refused, silenced: statuses };
    },
  };

  await runProgram(library, {
    ...topicScenarios(asking),
    ...serviceScenarios(asking),
    ...introspectionScenarios(asking),
    ...robotScenarios(asking),
    ...actionlibScenarios(asking),
    ...encodingScenarios(asking),
    ...transformScenarios(asking),
    ...only,
  });
}

main();
