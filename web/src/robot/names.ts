/** Names of types and topics, as both generations of ROS write them. */

/** `geometry_msgs/msg/Twist` and `geometry_msgs/Twist` → `geometry_msgs/Twist`. */
export function shortType(type: string): string {
  return type.replace(/\/(msg|srv|action)\//, "/");
}

/** A time of ROS 1 or ROS 2 in seconds; NaN for what is none. */
export function seconds(time: unknown): number {
  const { sec, nanosec, secs, nsecs } = (time ?? {}) as Record<string, number>;
  return Number(sec ?? secs) + Number(nanosec ?? nsecs) / 1e9;
}

/** A time of the robot's generation. */
export function rosTime(version: 1 | 2, milliseconds: number): Record<string, number> {
  const whole = Math.floor(milliseconds / 1000);
  const rest = Math.round((milliseconds - whole * 1000) * 1e6);
  return version === 2 ? { sec: whole, nanosec: rest } : { secs: whole, nsecs: rest };
}

/** A header without `seq`, which ROS 1's servers count themselves. */
export function header(version: 1 | 2, frame: string, milliseconds = Date.now()): Record<string, unknown> {
  return { stamp: rosTime(version, milliseconds), frame_id: frame };
}

export function frameName(name: unknown): string {
  return String(name ?? "").replace(/^\//, "");
}
