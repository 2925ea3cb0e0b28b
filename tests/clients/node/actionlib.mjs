// ROS 1 actions over topics: the library's client against the robot's server, and its server against its client.

import { pause } from './program.mjs';

const TYPE = 'actionlib_tutorials/FibonacciAction';

export function actionlibScenarios(asking) {
  const { ROSLIB, name: library } = asking.library;

  function send(client, order) {
    const goal = new ROSLIB.Goal({ actionClient: client, goalMessage: { order } });
    const statuses = [];
    const feedback = [];
    goal.on('status', ({ status }) => {
      if (statuses.at(-1) !== status) statuses.push(status);
    });
    goal.on('feedback', ({ sequence }) => feedback.push(sequence));
    const ended = new Promise((resolve) => {
      goal.on('result', (result) => resolve({ result: result.sequence, status: goal.status.status, statuses, feedback }));
    });
    goal.send();
    return { goal, feedback, ended };
  }

  async function clientOf(connections, serverName) {
    const ros = await connections.open();
    const client = new ROSLIB.ActionClient({ ros, serverName, actionName: TYPE });
    await asking.settled(ros);
    return client;
  }

  // A server in the client: counts up to `order`, aborts a negative one, and works on a large one until cancelled.
  async function serverAt(connections, serverName) {
    const ros = await connections.open();
    const server = new ROSLIB.SimpleActionServer({ ros, serverName, actionName: TYPE });
    server.on('goal', ({ order }) => {
      server.sendFeedback({ sequence: [0] });
      if (order < 0) server.setAborted({ sequence: [0, 1] });
      else if (order < 100) server.setSucceeded({ sequence: [0, 1, 1] });
    });
    server.on('cancel', () => server.setPreempted());
    await asking.settled(ros);
  }

  async function started({ feedback }) {
    while (feedback.length === 0) await pause(5);
  }

  return {
    async actionlib_goal(connections) {
      return send(await clientOf(connections, '/fibonacci'), 4).ended;
    },

    async actionlib_cancel(connections) {
      const running = send(await clientOf(connections, '/fibonacci'), 40);
      await started(running);
      running.goal.cancel();
      return running.ended;
    },

    async actionlib_cancel_all(connections) {
      const client = await clientOf(connections, '/fibonacci');
      const running = send(client, 40);
      await started(running);
      client.cancel();
      return running.ended;
    },

    async actionlib_server(connections) {
      const name = `/${library}/fibonacci`;
      await serverAt(connections, name);
      const client = await clientOf(connections, name);
      const succeeded = await send(client, 2).ended;
      const aborted = await send(client, -1).ended;
      const running = send(client, 100);
      await started(running);
      running.goal.cancel();
      return { succeeded, aborted, preempted: await running.ended };
    },
  };
}
