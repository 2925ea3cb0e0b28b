// The libraries' callback interfaces as promises, and the few steps that most scenarios share.

export class Asking {
  constructor(library) {
    this.library = library;
  }

  topic(ros, name, messageType, options = {}) {
    return new this.library.ROSLIB.Topic({ ros, name, messageType, ...options });
  }

  publish(topic, ...messages) {
    for (const message of messages) topic.publish(this.library.message(message));
  }

  // Resolves to every message so far once `count` have arrived; `messages` goes on growing.
  gather(topic, count) {
    const messages = [];
    const complete = new Promise((resolve) => {
      topic.subscribe((message) => {
        messages.push(message);
        if (messages.length === count) resolve(messages);
      });
    });
    return { messages, complete };
  }

  first(ros, name, messageType) {
    return new Promise((resolve) => this.topic(ros, name, messageType).subscribe(resolve));
  }

  service(ros, name, serviceType) {
    return new this.library.ROSLIB.Service({ ros, name, serviceType });
  }

  call(ros, name, serviceType, request, ...timeout) {
    return new Promise((resolve) => {
      this.service(ros, name, serviceType).callService(
        request,
        (values) => resolve({ values }),
        (reason) => resolve({ failed: reason }),
        ...timeout,
      );
    });
  }

  // Any method of the library that ends in a callback and a failure callback.
  ask(object, method, ...given) {
    return new Promise((resolve) => {
      object[method](
        ...given,
        (values) => resolve({ values: values ?? null }),
        (reason) => resolve({ failed: reason }),
      );
    });
  }

  // A server takes the frames of one connection in order: once this is answered, all before it has been done.
  async settled(ros) {
    await this.call(ros, '/rosapi/topic_type', 'rosapi/TopicType', { topic: '/chatter' });
  }
}
