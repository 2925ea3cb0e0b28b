// A program against the types that openapi-typescript made: it compiles only if they say what it uses.
import createClient from "openapi-fetch";
import type { components, paths } from "./robot.ts";

declare const process: { argv: string[] };

// The media type: the same resources are also streams of events.
const robot = createClient<paths, "application/json" | "application/problem+json">({ baseUrl: process.argv[2] });

const label = await robot.GET("/api/topics/open/label");
const text: string | undefined = label.data?.data;
console.log(text);

const sum = await robot.POST("/api/services/open/add", { body: { a: 40, b: 2 } });
console.log(sum.data?.sum);

const twist: components["schemas"]["geometry_msgs.Twist.Input"] = { angular: { z: -0.5 } };
const published = await robot.POST("/api/topics/open/heard", { body: twist });
console.log(published.response.status);

const goal = await robot.POST("/api/actions/open/count/goals", { body: { order: 101 } });
if (goal.data === undefined) throw new Error(goal.error?.detail);
const state = await robot.GET("/api/actions/open/count/goals/{goal_id}", {
  params: { path: { goal_id: goal.data.id } },
});
console.log(state.data?.state);
