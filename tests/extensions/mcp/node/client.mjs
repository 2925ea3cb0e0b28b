// The TypeScript SDK's client: it validates structured content against the output schemas, and subscribes.
import { Client } from "@modelcontextprotocol/sdk/client/index.js";
import { StreamableHTTPClientTransport } from "@modelcontextprotocol/sdk/client/streamableHttp.js";
import { ResourceUpdatedNotificationSchema } from "@modelcontextprotocol/sdk/types.js";

const [url, token] = process.argv.slice(2);
const client = new Client({ name: "typescript", version: "1.0.0" });
const updated = new Promise((resolve) => {
  client.setNotificationHandler(ResourceUpdatedNotificationSchema, ({ params }) => resolve(params.uri));
});
const requestInit = { headers: { Authorization: `Bearer ${token}` } };
await client.connect(new StreamableHTTPClientTransport(new URL(url), { requestInit }));

const { tools } = await client.listTools();
const structured = async (name, args = {}) => {
  const result = await client.callTool({ name, arguments: args });
  return result.isError ? result.content.map(({ text }) => text).join(" ") : result.structuredContent;
};
const found = {
  annotations: Object.fromEntries(tools.map(({ name, annotations }) => [name, annotations])),
  listed: await structured("list_robot"),
  battery: await structured("read_topic", { topic: "/battery" }),
  clamped: await structured("publish", { topic: "/cmd_vel", message: { linear: { x: 0.5 } } }),
  waits: await structured("call_service", { service: "/add", request: {}, timeout: 0.2 }),
};
await client.subscribeResource({ uri: "robot://topics/battery" });
found.updated = await updated;
await client.unsubscribeResource({ uri: "robot://topics/battery" });
await client.close();
console.log(JSON.stringify(found));
