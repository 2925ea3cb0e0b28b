// The encodings in which a topic can be had, each beside the same topic as JSON.

// Typed arrays and byte strings as plain numbers, so that they can be printed.
function plain(value) {
  if (ArrayBuffer.isView(value)) return { kind: value.constructor.name, items: Array.from(value, Number) };
  if (Array.isArray(value)) return value.map(plain);
  if (value === null || typeof value !== 'object') return value;
  return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, plain(each)]));
}

const MESSAGES = {
  'std_msgs/String': { data: 'grüße \u{1F916} "\\' },
  'geometry_msgs/PoseWithCovarianceStamped': {
    header: { stamp: { secs: 5, nsecs: 7 }, frame_id: 'odom' },
    pose: { pose: { position: { x: 1.5, y: -2 } }, covariance: Array.from({ length: 36 }, (_, index) => index) },
  },
  'sensor_msgs/JointState': {
    header: { stamp: { secs: 5, nsecs: 7 }, frame_id: '' },
    name: ['left', 'right'],
    position: [0.25, -1],
  },
  'sensor_msgs/LaserScan': {
    header: { stamp: { secs: 5, nsecs: 7 }, frame_id: 'laser' },
    range_max: 10,
    ranges: [0.5, 1.25, 8],
  },
  'nav_msgs/OccupancyGrid': {
    header: { stamp: { secs: 5, nsecs: 7 }, frame_id: 'map' },
    info: { width: 3, height: 1, resolution: 0.5 },
    data: [-1, 0, 100],
  },
  'sensor_msgs/PointCloud2': {
    header: { stamp: { secs: 5, nsecs: 7 }, frame_id: 'lidar' },
    width: 1,
    fields: [{ name: 'x', offset: 0, datatype: 7, count: 1 }],
    data: 'AACAPw==',
  },
};

export function encodingScenarios(asking) {
  const at = (name) => `/${asking.library.name}/encodings/${name}`;

  // One message of each type to one subscriber of each encoding; what each of them got, by type.
  async function compare(connections, place, compressions) {
    const speaking = await connections.open();
    const observed = {};
    for (const [type, message] of Object.entries(MESSAGES)) {
      const name = at(`${place}/${type.split('/')[1]}`);
      const heard = [];
      for (const compression of compressions) {
        const ros = await connections.open();
        heard.push(asking.gather(asking.topic(ros, name, type, { compression }), 1).complete);
        await asking.settled(ros);
      }
      asking.publish(asking.topic(speaking, name, type), message);
      observed[type] = (await Promise.all(heard)).map(([each]) => plain(each));
    }
    return observed;
  }

  // A topic whose subscription asks for pieces of `size` characters, which the library has no option for.
  async function inPieces(connections, name, size, options, ...messages) {
    const hearing = await connections.open();
    const { complete } = asking.gather(asking.topic(hearing, at(name), 'std_msgs/String', options), messages.length);
    const wish = { op: 'subscribe', id: 'pieces', topic: at(name), fragment_size: size, compression: options.compression };
    hearing.callOnConnection(wish);
    await asking.settled(hearing);
    asking.publish(asking.topic(await connections.open(), at(name), 'std_msgs/String'), ...messages);
    return (await complete).map((message) => message.data);
  }

  return {
    cbor: (connections) => compare(connections, 'cbor', ['none', 'cbor']),
    png: (connections) => compare(connections, 'png', ['none', 'png']),
    cbor_raw: (connections) => compare(connections, 'raw', ['cbor-raw', 'none']),

    // What the robot publishes by itself, with arrays of fixed size and of texts.
    async robot_in_cbor(connections) {
      const ros = await connections.open();
      const seen = {};
      for (const [name, type] of [['/odom', 'nav_msgs/Odometry'], ['/joint_states', 'sensor_msgs/JointState']]) {
        const topic = asking.topic(ros, name, type, { compression: 'cbor' });
        [seen[name]] = (await asking.gather(topic, 1).complete).map(plain);
        topic.unsubscribe();
      }
      return seen;
    },

    // The robot's own map, as ros2djs and ros3djs ask for it.
    async map_in_every_encoding(connections) {
      const seen = {};
      for (const compression of ['none', 'png', 'cbor']) {
        const ros = await connections.open();
        const topic = asking.topic(ros, '/map', 'nav_msgs/OccupancyGrid', { compression, queue_length: 1 });
        const [{ info, data }] = await asking.gather(topic, 1).complete;
        seen[compression] = { width: info.width, height: info.height, data: Array.from(data) };
      }
      return {
        size: seen.none.width * seen.none.height === seen.none.data.length,
        same: ['png', 'cbor'].every((each) => JSON.stringify(seen[each]) === JSON.stringify(seen.none)),
      };
    },

    async pieces(connections) {
      const texts = ['short', 'long '.repeat(100), 'ä'.repeat(200)];
      const heard = await inPieces(connections, 'pieces', 64, {}, ...texts.map((data) => ({ data })));
      return heard.map((text, index) => text === texts[index]);
    },

    async pictures_in_pieces(connections) {
      const texts = ['one '.repeat(100), 'two '.repeat(200)];
      const options = { compression: 'png' };
      const heard = await inPieces(connections, 'pictures', 64, options, ...texts.map((data) => ({ data })));
      return heard.map((text, index) => text === texts[index]);
    },
  };
}
