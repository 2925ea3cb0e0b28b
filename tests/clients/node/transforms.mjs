// The libraries' TF clients against the server's republisher, which follows the demo robot.

import { pause } from './program.mjs';

export function transformScenarios(asking) {
  const { ROSLIB } = asking.library;

  // Where the laser and then the robot are; the second frame makes the client ask anew. Then the robot drives.
  async function watch(ros, client) {
    await asking.call(ros, '/reset', 'std_srvs/Empty', {});
    const heard = { laser: [], base: [] };
    client.subscribe('laser', (transform) => heard.laser.push(transform));
    while (heard.laser.length === 0) await pause(5);
    client.subscribe('/base_link', (transform) => heard.base.push(transform));
    while (heard.base.length === 0) await pause(5);
    const [laser] = heard.laser;
    const before = heard.base.at(-1).translation;
    const stick = asking.topic(ros, '/cmd_vel', 'geometry_msgs/Twist');
    while (heard.base.at(-1).translation.x < before.x + 0.1) {
      asking.publish(stick, { linear: { x: 0.3 } });
      await pause(50);
    }
    const moved = heard.base.at(-1).translation.x - before.x;
    client.dispose();
    await asking.settled(ros);
    return { laser, before, moved };
  }

  const options = (ros) => ({ ros, fixedFrame: 'odom', angularThres: 0.01, transThres: 0.01, rate: 20 });

  const scenarios = {
    async tf_over_topics(connections) {
      const ros = await connections.open();
      return watch(ros, new ROSLIB.TFClient(options(ros)));
    },

    // How roslib 1 asks when it is told that the server is not an old one; roslib 2 has no such option.
    async tf_service(connections) {
      const ros = await connections.open({ groovyCompatibility: false });
      return watch(ros, new ROSLIB.TFClient({ ...options(ros), topicTimeout: 1.5 }));
    },

    async tf_ros2(connections) {
      const ros = await connections.open();
      return watch(ros, new ROSLIB.ROS2TFClient(options(ros)));
    },

    // Two widgets of one page, with other frames and other fixed frames.
    async tf_twice(connections) {
      const ros = await connections.open();
      const other = new ROSLIB.TFClient({ ros, fixedFrame: '/base_link' });
      const wheels = [];
      other.subscribe('left_wheel_link', ({ translation }) => wheels.push(translation));
      const observed = await watch(ros, new ROSLIB.TFClient(options(ros)));
      while (wheels.length === 0) await pause(5);
      return { ...observed, wheel: wheels[0] };
    },
  };
  return scenarios;
}
