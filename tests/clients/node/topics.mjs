// Publishing and subscribing.

import { connect, disconnect, next, pause } from './program.mjs';

export function topicScenarios(asking) {
  const at = (name) => `/${asking.library.name}/${name}`;
  const word = (data) => ({ data });
  const words = (from, to) => Array.from({ length: to - from }, (_, index) => word(String(from + index)));
  const data = (messages) => messages.map((message) => message.data);

  // One subscriber and one publisher on two connections, the subscription made before anything is published.
  async function pair(connections, name, type, options = {}) {
    const [hearing, speaking] = [await connections.open(), await connections.open()];
    const heard = asking.topic(hearing, at(name), type, options);
    const spoken = asking.topic(speaking, at(name), type);
    return { hearing, speaking, heard, spoken };
  }

  async function exchange(connections, name, type, ...messages) {
    const { hearing, heard, spoken } = await pair(connections, name, type);
    const { complete } = asking.gather(heard, messages.length);
    await asking.settled(hearing);
    asking.publish(spoken, ...messages);
    return complete;
  }

  return {
    async publish_and_subscribe(connections) {
      const spoken = ['one', 'zwei "äöü" \\ /', '三 \u{1F916} \u0000\n', ''];
      return data(await exchange(connections, 'words', 'std_msgs/String', ...spoken.map(word)));
    },

    async own_publication_comes_back(connections) {
      const ros = await connections.open();
      const { complete } = asking.gather(asking.topic(ros, at('own'), 'std_msgs/String'), 1);
      asking.publish(asking.topic(ros, at('own'), 'std_msgs/String'), word('mine'));
      return data(await complete);
    },

    async three_part_type(connections) {
      return data(await exchange(connections, 'three_part', 'std_msgs/msg/String', word('modern')));
    },

    async relative_name(connections) {
      const [hearing, speaking] = [await connections.open(), await connections.open()];
      const name = `${asking.library.name}_relative`;
      const { complete } = asking.gather(asking.topic(hearing, name, 'std_msgs/String'), 1);
      await asking.settled(hearing);
      asking.publish(asking.topic(speaking, `/${name}`, 'std_msgs/String'), word('near'));
      return data(await complete);
    },

    async type_inferred(connections) {
      const { hearing, speaking, spoken } = await pair(connections, 'inferred', 'std_msgs/String');
      spoken.advertise();
      await asking.settled(speaking);
      const { complete } = asking.gather(asking.topic(hearing, at('inferred'), undefined), 1);
      await asking.settled(hearing);
      asking.publish(spoken, word('known'));
      return data(await complete);
    },

    async partial_message(connections) {
      const [message] = await exchange(connections, 'partial', 'geometry_msgs/Twist', { linear: { x: 1.5 } });
      return message;
    },

    // Each value under the name of its type, as the other side received it.
    async values(connections) {
      const sent = [
        ['Float64', { data: 0.1 }],
        ['Float64', { data: NaN }],
        ['Float64', { data: 3 }],
        ['Float32', { data: 0.1 }],
        ['Int64', { data: Number.MAX_SAFE_INTEGER }],
        ['Int64', { data: Number.MIN_SAFE_INTEGER }],
        ['Bool', { data: true }],
        ['UInt8MultiArray', { data: [1, 2, 255] }],
        ['UInt8MultiArray', { data: 'AQL/' }],
        ['UInt8MultiArray', { data: [] }],
        ['Int8MultiArray', { data: [-1, 2] }],
        ['Float64MultiArray', { data: [1, NaN, 2.5] }],
        ['ColorRGBA', { r: 1 }],
      ];
      const received = [];
      for (const [index, [type, message]] of sent.entries()) {
        const [heard] = await exchange(connections, `value_${index}`, `std_msgs/${type}`, message);
        received.push([type, heard.data ?? (type === 'ColorRGBA' ? heard : null)]);
      }
      return received;
    },

    async header_is_stamped(connections) {
      const [empty, given] = await exchange(
        connections,
        'stamped',
        'geometry_msgs/PointStamped',
        { header: {}, point: { x: 1 } },
        { header: { stamp: { secs: 12, nsecs: 34 }, frame_id: 'map' } },
      );
      return { empty, given, now: Date.now() / 1000 };
    },

    async time_in_either_spelling(connections) {
      const type = 'std_msgs/Header';
      const sent = [{ stamp: { sec: 1, nanosec: 2 } }, { stamp: { secs: 3, nsecs: 4 } }];
      return (await exchange(connections, 'times', type, ...sent)).map((header) => header.stamp);
    },

    async bad_messages_are_dropped(connections) {
      const sent = [{ data: 'first' }, { data: 7 }, { bogus: 1 }, { data: 'x', bogus: 1 }, { data: 'last' }];
      const { hearing, heard, spoken } = await pair(connections, 'dropped', 'std_msgs/String');
      const { complete } = asking.gather(heard, 2);
      await asking.settled(hearing);
      asking.publish(spoken, ...sent);
      return data(await complete);
    },

    async type_conflict(connections) {
      const { hearing, speaking, heard, spoken } = await pair(connections, 'conflict', 'std_msgs/String');
      const { complete } = asking.gather(heard, 1);
      await asking.settled(hearing);
      asking.publish(asking.topic(await connections.open(), at('conflict'), 'std_msgs/Int32'), { data: 1 });
      await asking.settled(speaking);
      asking.publish(spoken, word('still text'));
      return { received: data(await complete), type: await asking.ask(hearing, 'getTopicType', at('conflict')) };
    },

    // One burst into three throttled subscriptions with queues of 0, 1 and 2: what each was given in the end, and
    // how long after the burst began the last of it came.
    async throttled(connections) {
      const heard = [];
      for (const [queue_length, count] of [1, 2, 3].entries()) {
        const ros = await connections.open();
        const options = { throttle_rate: 300, queue_length };
        heard.push(asking.gather(asking.topic(ros, at('throttled'), 'std_msgs/String', options), count));
        await asking.settled(ros);
      }
      const start = performance.now();
      const elapsed = heard.map(({ complete }) => complete.then(() => performance.now() - start));
      asking.publish(asking.topic(await connections.open(), at('throttled'), 'std_msgs/String'), ...words(0, 10));
      const milliseconds = await Promise.all(elapsed);
      await pause(400);
      return heard.map(({ messages }, index) => ({ received: data(messages), milliseconds: milliseconds[index] }));
    },

    // The latched message reaches each late subscriber once; the second message shows that it came only once.
    async latched(connections) {
      const speaking = await connections.open();
      const spoken = asking.topic(speaking, at('latched'), 'std_msgs/String', { latch: true });
      asking.publish(spoken, word('old'), word('kept'));
      await asking.settled(speaking);
      const late = [await connections.open(), await connections.open()].map((ros) =>
        asking.gather(asking.topic(ros, at('latched'), 'std_msgs/String'), 2),
      );
      await Promise.all(connections.opened.map((ros) => asking.settled(ros)));
      asking.publish(spoken, word('new'));
      return Promise.all(late.map(async ({ complete }) => data(await complete)));
    },

    // Two subscriptions of one client are one delivery, which the library hands to both.
    async two_subscriptions(connections) {
      const { hearing, heard, spoken } = await pair(connections, 'twice', 'std_msgs/String');
      const other = asking.topic(hearing, at('twice'), 'std_msgs/String');
      const [first, second] = [asking.gather(heard, 2), asking.gather(other, 4)];
      await asking.settled(hearing);
      asking.publish(spoken, ...words(0, 2));
      await first.complete;
      heard.unsubscribe();
      await asking.settled(hearing);
      asking.publish(spoken, ...words(2, 4));
      await second.complete;
      return { unsubscribed: data(first.messages), kept: data(second.messages) };
    },

    async unsubscribe(connections) {
      const { hearing, heard, spoken } = await pair(connections, 'left', 'std_msgs/String');
      const left = asking.gather(heard, 1);
      const stays = asking.gather(asking.topic(await connections.open(), at('left'), 'std_msgs/String'), 2);
      await Promise.all(connections.opened.map((ros) => asking.settled(ros)));
      asking.publish(spoken, word('one'));
      await left.complete;
      heard.unsubscribe();
      await asking.settled(hearing);
      asking.publish(spoken, word('two'));
      await stays.complete;
      await asking.settled(hearing);
      return { left: data(left.messages), stays: data(stays.messages) };
    },

    async many_in_order(connections) {
      const received = await exchange(connections, 'many', 'std_msgs/String', ...words(0, 500));
      return received.every((message, index) => message.data === String(index)) ? received.length : data(received);
    },

    async large_message(connections) {
      const text = '0123456789abcdef'.repeat(65536);
      const [message] = await exchange(connections, 'large', 'std_msgs/String', word(text));
      return { length: message.data.length, same: message.data === text };
    },

    // Milliseconds from one client's publish to the other's callback, when the other has just been answered.
    async delivery_time(connections) {
      const times = [];
      for (let turn = 0; turn < 5; turn += 1) {
        const { hearing, speaking, heard, spoken } = await pair(connections, `prompt_${turn}`, 'std_msgs/String');
        const { complete } = asking.gather(heard, 1);
        spoken.advertise();
        await asking.settled(speaking);
        await asking.settled(hearing);
        const start = performance.now();
        asking.publish(spoken, word('now'));
        await complete;
        times.push(performance.now() - start);
      }
      return times.sort((a, b) => a - b);
    },

    // The library subscribes and advertises again by itself after it has connected again.
    async reconnect(connections) {
      const { hearing, speaking, heard, spoken } = await pair(connections, 'again', 'std_msgs/String');
      const { messages, complete } = asking.gather(heard, 2);
      await asking.settled(hearing);
      asking.publish(spoken, word('before'));
      await asking.settled(speaking);
      while (messages.length === 0) await pause(5);
      await Promise.all([disconnect(hearing), disconnect(speaking)]);
      await Promise.all([connect(hearing, connections.url), connect(speaking, connections.url)]);
      await asking.settled(hearing);
      asking.publish(spoken, word('after'));
      return data(await complete);
    },

    async set_level(connections) {
      const { hearing, speaking, heard, spoken } = await pair(connections, 'level', 'std_msgs/String');
      const { complete } = asking.gather(heard, 4);
      await asking.settled(hearing);
      for (const level of ['none', 'error', 'warning', 'info']) {
        speaking.setStatusLevel(level, `level:${level}`);
        asking.publish(spoken, word(level));
      }
      return data(await complete);
    },

    async server_goes_away(connections) {
      const ros = await connections.open();
      const closed = next(ros, 'close');
      asking.publish(asking.topic(ros, at('ready'), 'std_msgs/String', { latch: true }), word('ready'));
      const { code, wasClean } = await closed;
      return { code, wasClean };
    },

    // The two halves of a conversation between programs: the listener says when it is there.
    async listen(connections, name) {
      const ros = await connections.open();
      const { complete } = asking.gather(asking.topic(ros, name, 'std_msgs/String'), 3);
      await asking.settled(ros);
      asking.publish(asking.topic(ros, `${name}/ready`, 'std_msgs/String', { latch: true }), word('ready'));
      return data(await complete);
    },

    async talk(connections, name) {
      const ros = await connections.open();
      await asking.first(ros, `${name}/ready`, 'std_msgs/String');
      asking.publish(asking.topic(ros, name, 'std_msgs/String'), ...['grüße', '二', '3'].map(word));
      await asking.settled(ros);
      return 'said';
    },
  };
}
