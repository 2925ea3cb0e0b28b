// Calling services, and providing them from the client.

import { disconnect } from './program.mjs';

const ADD = 'example_interfaces/AddTwoInts';

export function serviceScenarios(asking) {
  const at = (name) => `/${asking.library.name}/${name}`;
  const request = (values) => asking.library.request(values);
  const add = (ros, name, values) => asking.call(ros, name, ADD, values);

  // A provider on a connection of its own; `handler` is what the library takes.
  async function provide(connections, name, handler) {
    const provider = await connections.open();
    const service = asking.service(provider, at(name), ADD);
    await service.advertise(handler);
    await asking.settled(provider);
    return { provider, service, caller: await connections.open() };
  }

  return {
    async call(connections) {
      const ros = await connections.open();
      return {
        named: await add(ros, '/add_two_ints', request({ a: 1, b: 2 })),
        partial: await add(ros, '/add_two_ints', request({ a: 4 })),
        positional: await add(ros, '/add_two_ints', [20, 22]),
        empty: await add(ros, '/add_two_ints', request({})),
        relative: await add(ros, 'add_two_ints', request({ a: -1, b: -2 })),
      };
    },

    async call_unknown(connections) {
      return add(await connections.open(), '/no_such_service', request({}));
    },

    async call_bad_arguments(connections) {
      const ros = await connections.open();
      return {
        unknown_field: await add(ros, '/add_two_ints', request({ bogus: 1 })),
        wrong_type: await add(ros, '/add_two_ints', request({ a: 'one' })),
        afterwards: await add(ros, '/add_two_ints', request({ a: 1 })),
      };
    },

    async provide_success(connections) {
      const { caller } = await provide(connections, 'adds', (given, response) => {
        response.sum = given.a + given.b;
        return true;
      });
      return {
        answer: await add(caller, at('adds'), request({ a: 40, b: 2 })),
        defaults: await add(caller, at('adds'), request({})),
        type: await asking.ask(caller, 'getServiceType', at('adds')),
      };
    },

    async provide_failure(connections) {
      const { caller } = await provide(connections, 'refuses', () => false);
      return add(caller, at('refuses'), request({ a: 1 }));
    },

    async provide_bad_answer(connections) {
      const { caller } = await provide(connections, 'lies', (given, response) => {
        response.sum = 'a lot';
        return true;
      });
      return add(caller, at('lies'), request({ a: 1 }));
    },

    async provide_on_own_connection(connections) {
      const { provider } = await provide(connections, 'own', (given, response) => {
        response.sum = given.a;
        return true;
      });
      return add(provider, at('own'), request({ a: 7 }));
    },

    async provider_unadvertises(connections) {
      const { provider, service, caller } = await provide(connections, 'leaves', () => true);
      await service.unadvertise();
      await asking.settled(provider);
      return add(caller, at('leaves'), request({}));
    },

    // The call has reached the provider, which then leaves without an answer.
    async provider_disconnects(connections) {
      const { provider, caller } = await provide(connections, 'dies', () => {
        disconnect(provider);
        return true;
      });
      const during = await add(caller, at('dies'), request({}));
      return { during, afterwards: await add(caller, at('dies'), request({})) };
    },

    // One call answered for another program, which says in between that it is there.
    async serve(connections, name) {
      const ros = await connections.open();
      const service = asking.service(ros, name, ADD);
      const answered = new Promise((resolve) => {
        service.advertise((given, response) => {
          response.sum = given.a + given.b;
          resolve(given);
          return true;
        });
      });
      await asking.settled(ros);
      const ready = asking.topic(ros, `${name}/ready`, 'std_msgs/String', { latch: true });
      asking.publish(ready, { data: 'ready' });
      const given = await answered;
      await asking.settled(ros);
      return given;
    },

    async call_other(connections, name) {
      const ros = await connections.open();
      await asking.first(ros, `${name}/ready`, 'std_msgs/String');
      return add(ros, name, request({ a: 5, b: 6 }));
    },
  };
}
