// rosapi through every method that the library has for it, and parameters.

export function introspectionScenarios(asking) {
  const has = (ros, name) => asking.call(ros, '/rosapi/has_param', 'rosapi/HasParam', { name });

  async function decoded(ros, type) {
    const details = await asking.ask(ros, 'getMessageDetails', type);
    return details.failed === undefined ? ros.decodeTypeDefs(details.values) : details;
  }

  return {
    async rosapi_topics(connections) {
      const ros = await connections.open();
      return {
        topics: await asking.ask(ros, 'getTopics'),
        type: await asking.ask(ros, 'getTopicType', '/odom'),
        unknown: await asking.ask(ros, 'getTopicType', '/no_such_topic'),
        of_type: await asking.ask(ros, 'getTopicsForType', 'nav_msgs/Odometry'),
        of_three_part_type: await asking.ask(ros, 'getTopicsForType', 'nav_msgs/msg/Odometry'),
        raw: await asking.ask(ros, 'getTopicsAndRawTypes'),
      };
    },

    async rosapi_services(connections) {
      const ros = await connections.open();
      const { values: type } = await asking.ask(ros, 'getServiceType', '/add_two_ints');
      return {
        services: await asking.ask(ros, 'getServices'),
        type,
        unknown: await asking.ask(ros, 'getServiceType', '/no_such_service'),
        of_type: await asking.ask(ros, 'getServicesForType', type),
        request: await asking.ask(ros, 'getServiceRequestDetails', type),
        response: await asking.ask(ros, 'getServiceResponseDetails', type),
      };
    },

    async rosapi_nodes(connections) {
      const ros = await connections.open();
      const nodes = await asking.ask(ros, 'getNodes');
      // 1.4.1 hands over the three lists one by one when it is given a second callback.
      const details = await new Promise((resolve) => {
        const both = (first, second, third) =>
          resolve(Array.isArray(first) ? { subscribing: first, publishing: second, services: third } : first);
        ros.getNodeDetails('/demo_robot', both, (reason) => resolve({ failed: reason }));
      });
      return { nodes, details };
    },

    async rosapi_messages(connections) {
      const ros = await connections.open();
      return {
        details: await asking.ask(ros, 'getMessageDetails', 'geometry_msgs/Twist'),
        twist: await decoded(ros, 'geometry_msgs/Twist'),
        odometry: await decoded(ros, 'nav_msgs/Odometry'),
        unknown: await asking.ask(ros, 'getMessageDetails', 'no_such_msgs/Thing'),
      };
    },

    async rosapi_actions(connections) {
      return asking.ask(await connections.open(), 'getActionServers');
    },

    async robot_parameter(connections, name) {
      const ros = await connections.open();
      const parameter = new asking.library.ROSLIB.Param({ ros, name });
      const names = await asking.ask(ros, 'getParams');
      const before = await asking.ask(parameter, 'get');
      const set = await asking.ask(parameter, 'set', 0.25);
      const after = await asking.ask(parameter, 'get');
      const restored = await asking.ask(parameter, 'set', before.values);
      return { listed: names.values.includes(name), before, set, after, restored, has: await has(ros, name) };
    },

    async refused_parameter(connections, name) {
      const parameter = new asking.library.ROSLIB.Param({ ros: await connections.open(), name });
      const before = await asking.ask(parameter, 'get');
      const word = await asking.ask(parameter, 'set', 'fast');
      const negative = await asking.ask(parameter, 'set', -1.5);
      return { word, negative, unchanged: (await asking.ask(parameter, 'get')).values === before.values };
    },

    // A name that no node has declared, as programs for ROS 1 use them.
    async own_parameter(connections) {
      const ros = await connections.open();
      const name = `/${asking.library.name}/answer`;
      const parameter = new asking.library.ROSLIB.Param({ ros, name });
      const had = await has(ros, name);
      const kept = [];
      for (const value of [42, -0.5, 'text "ü"', true, [1, 2, 3], ['a', 'b']]) {
        await asking.ask(parameter, 'set', value);
        kept.push((await asking.ask(parameter, 'get')).values);
      }
      const listed = (await asking.ask(ros, 'getParams')).values.includes(name);
      const has_now = await has(ros, name);
      await asking.ask(parameter, 'delete');
      return { had, kept, listed, has_now, has_after: await has(ros, name), get_after: await asking.ask(parameter, 'get') };
    },
  };
}
