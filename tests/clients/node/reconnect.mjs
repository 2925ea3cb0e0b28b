// Runs the lines of the how-to page that make a page of roslib come back, given as text, and prints what it receives.
// Usage: node reconnect.mjs roslib1|roslib2 LINES

import { createRequire } from 'node:module';

const [name, lines] = process.argv.slice(2);
const ROSLIB = name === 'roslib1' ? createRequire(import.meta.url)('roslib1') : await import('roslib');
const ros = new Function('ROSLIB', `${lines}\nreturn ros;`)(ROSLIB);
ros.on('connection', () => console.log('connected'));
const topic = new ROSLIB.Topic({ ros, name: '/words', messageType: 'std_msgs/String' });
topic.subscribe((message) => console.log(message.data));
