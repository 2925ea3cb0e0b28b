// What a page does with the demo robot.

import { pause } from './program.mjs';

const TOPICS = [
  '/odom', '/tf', '/tf_static', '/scan', '/map', '/battery_state', '/joint_states', '/diagnostics', '/chatter',
  '/robot_description',
];

export function robotScenarios(asking) {
  const place = ({ x, y }) => [x, y];

  return {
    // One message of each topic; the types are left to the server.
    async robot_topics(connections) {
      const ros = await connections.open();
      const messages = await Promise.all(TOPICS.map((name) => asking.first(ros, name, undefined)));
      return Object.fromEntries(TOPICS.map((name, index) => [name, messages[index]]));
    },

    // Drives for a second, lets go of the stick and waits until the robot has stopped by itself.
    async drive(connections) {
      const ros = await connections.open();
      await asking.call(ros, '/reset', 'std_srvs/Empty', {});
      let last;
      const speeds = [];
      const odometry = asking.topic(ros, '/odom', 'nav_msgs/Odometry');
      odometry.subscribe((message) => {
        last = message;
        speeds.push(message.twist.twist.linear.x);
      });
      while (last === undefined) await pause(10);
      const before = place(last.pose.pose.position);
      const stick = asking.topic(ros, '/cmd_vel', 'geometry_msgs/Twist');
      for (let step = 0; step < 10; step += 1) {
        asking.publish(stick, { linear: { x: 0.3 } });
        await pause(100);
      }
      while (last.twist.twist.linear.x !== 0) await pause(10);
      const after = place(last.pose.pose.position);
      return { before, after, fastest: Math.max(...speeds), speed: last.twist.twist.linear.x };
    },
  };
}
