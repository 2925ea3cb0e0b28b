// ROS 2 actions both ways (roslib 2.1.0 only: the older releases have none).

import { disconnect, pause } from './program.mjs';

const TYPE = 'example_interfaces/Fibonacci';

export function actionScenarios(asking) {
  const { ROSLIB, name: library } = asking.library;
  const at = (name) => `/${library}/${name}`;

  function send(ros, name, goal, type = TYPE) {
    const action = new ROSLIB.Action({ ros, name, actionType: type });
    const feedback = [];
    let id;
    const ended = new Promise((resolve) => {
      id = action.sendGoal(
        goal,
        (values) => resolve({ values, feedback }),
        ({ sequence }) => feedback.push(sequence),
        (reason) => resolve({ failed: reason, feedback }),
      );
    });
    return { ended, feedback, action, cancel: () => action.cancelGoal(id) };
  }

  // As `send`, for an action of any type: how it ended and the feedback as it came.
  function sendTo(ros, name, goal, type) {
    const action = new ROSLIB.Action({ ros, name, actionType: type });
    const feedback = [];
    return new Promise((resolve) => {
      const end = (outcome) => resolve({ outcome, feedback });
      action.sendGoal(goal, () => end('succeeded'), (values) => feedback.push(values), end);
    });
  }

  async function started({ feedback }) {
    while (feedback.length === 0) await pause(5);
  }

  // Counts for a small order, aborts a negative one, and works on a large one until it is cancelled.
  async function provide(ros, name) {
    const action = new ROSLIB.Action({ ros, name, actionType: TYPE });
    const seen = { goals: [], cancels: 0 };
    action.advertise(
      (goal, id) => {
        seen.goals.push(goal);
        action.sendFeedback(id, { sequence: [0] });
        if (goal.order < 0) action.setFailed(id);
        else if (goal.order < 100) {
          action.sendFeedback(id, { sequence: [0, 1] });
          action.setSucceeded(id, { sequence: [0, 1, goal.order] });
        }
      },
      (id) => {
        seen.cancels += 1;
        action.setCanceled(id, { sequence: [0, 5] });
      },
    );
    await asking.settled(ros);
    return { action, seen };
  }

  async function providerAndCaller(connections, name) {
    const provider = await connections.open();
    const { action, seen } = await provide(provider, at(name));
    return { provider, action, seen, caller: await connections.open() };
  }

  return {
    async action_goal(connections) {
      return send(await connections.open(), '/fibonacci', { order: 4 }).ended;
    },

    async action_cancel(connections) {
      const running = send(await connections.open(), '/fibonacci', { order: 40 });
      await started(running);
      running.cancel();
      return running.ended;
    },

    async action_cancel_all(connections) {
      const ros = await connections.open();
      const both = [send(ros, '/fibonacci', { order: 40 }), send(ros, '/fibonacci', { order: 40 })];
      await Promise.all(both.map(started));
      both[0].action.cancelAllGoals();
      return (await Promise.all(both.map(({ ended }) => ended))).map(({ failed }) => failed);
    },

    async action_refused(connections) {
      const ros = await connections.open();
      return {
        unknown: await send(ros, '/no_such_action', { order: 1 }).ended,
        bad_field: await send(ros, '/fibonacci', { bogus: 1 }).ended,
        wrong_type: await send(ros, '/fibonacci', { order: 'many' }).ended,
        unknown_type: await send(ros, '/fibonacci', { order: 1 }, 'no_such_msgs/Thing').ended,
        by_the_server: await send(ros, '/fibonacci', { order: 47 }).ended,
      };
    },

    async action_provided(connections) {
      const { seen, caller } = await providerAndCaller(connections, 'counts');
      const succeeded = await send(caller, at('counts'), { order: 7 }).ended;
      const aborted = await send(caller, at('counts'), { order: -1 }).ended;
      const running = send(caller, at('counts'), { order: 100 });
      await started(running);
      running.cancel();
      const canceled = await running.ended;
      return { succeeded, aborted, canceled, seen };
    },

    async action_several_goals(connections) {
      const { caller, seen } = await providerAndCaller(connections, 'several');
      const goals = [100, 1, 101, 2].map((order) => send(caller, at('several'), { order }));
      await Promise.all(goals.map(started));
      goals[2].cancel();
      goals[0].cancel();
      const ends = await Promise.all(goals.map(({ ended }) => ended));
      return { ends, cancels: seen.cancels };
    },

    async action_provider_disconnects(connections) {
      const { provider, caller } = await providerAndCaller(connections, 'dies');
      const running = send(caller, at('dies'), { order: 100 });
      await started(running);
      await disconnect(provider);
      return { during: await running.ended, afterwards: await send(caller, at('dies'), { order: 1 }).ended };
    },

    async action_unadvertised(connections) {
      const { provider, action, caller } = await providerAndCaller(connections, 'leaves');
      const running = send(caller, at('leaves'), { order: 100 });
      await started(running);
      action.unadvertise();
      await asking.settled(provider);
      return { during: await running.ended, afterwards: await send(caller, at('leaves'), { order: 1 }).ended };
    },

    // An action for another program's three goals.
    async act(connections, name) {
      const ros = await connections.open();
      const { seen } = await provide(ros, name);
      const ready = asking.topic(ros, `${name}/ready`, 'std_msgs/String', { latch: true });
      asking.publish(ready, { data: 'ready' });
      await asking.first(ros, `${name}/done`, 'std_msgs/String');
      return seen;
    },

    // The demo robot drives itself to a place nearby, and cannot drive out of its walls.
    async navigate(connections) {
      const ros = await connections.open();
      await asking.call(ros, '/reset', 'std_srvs/Empty', {});
      const place = async () => (await asking.first(ros, '/odom', 'nav_msgs/Odometry')).pose.pose.position;
      const start = await place();
      const to = (x) => {
        const pose = { position: { ...start, x }, orientation: { w: 1 } };
        const goal = { pose: { header: { frame_id: 'odom' }, pose } };
        return sendTo(ros, '/navigate_to_pose', goal, 'nav2_msgs/NavigateToPose');
      };
      const near = await to(start.x + 0.4);
      const end = await place();
      return { near: near.outcome, feedback: near.feedback.length, moved: end.x - start.x, far: (await to(1000)).outcome };
    },
  };
}
