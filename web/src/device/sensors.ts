/** The sensors of the device that shows the page, as topics of the robot. Each begins only when it is asked for. */

import { header } from "../robot/names";
import type { RobotSession } from "../robot/session";
import type { Message } from "../robot/subscriptions";

/** Callbacks of a sensor: for its messages and its errors. */
export interface SensorHost {
  version: 1 | 2;
  frame: string;
  /** Value sent for an unknown number: NaN, or 0 to servers that may reject it. */
  unknown: number;
  publish: (message: Message) => void;
  /** Publish a description of the format, if the sensor has a topic for that. */
  describe: (message: Message) => void;
  fail: (text: string) => void;
}

export interface Sensor {
  name: "motion" | "position" | "battery" | "camera" | "microphone" | "joystick";
  /** Without `/msg/`. */
  type: string;
  /** Below the device's namespace. */
  topic: string;
  /** Where it tells how its messages are to be read. */
  description?: { type: string; topic: string };
  /** True if this browser supports the sensor on this page. */
  available(): boolean;
  /** Begin; what is returned ends it. May ask the person, who may refuse: then it throws. */
  start(host: SensorHost): Promise<() => void>;
}

const GRAVITY = 9.80665;
/** Milliseconds between two messages of what the browser reports more often. */
const PERIOD = 50;
/** Milliseconds between two messages of what the browser reports only on changes. */
const SLOW = 1000;
const CAMERA_PERIOD = 100;
const CAMERA_WIDTH = 640;
const JPEG_QUALITY = 0.7;

/** Unknown, in the covariance of sensor_msgs/Imu. */
const UNKNOWN = [-1, 0, 0, 0, 0, 0, 0, 0, 0];
const RADIANS = Math.PI / 180;

/** The turn of a device by the angles that browsers tell (W3C: Z-X'-Y'', in degrees), as a quaternion. */
export function quaternionOf(alpha: number, beta: number, gamma: number) {
  const [z, x, y] = [alpha, beta, gamma].map((angle) => (angle * RADIANS) / 2) as [number, number, number];
  const [cz, sz, cx, sx, cy, sy] = [
    Math.cos(z),
    Math.sin(z),
    Math.cos(x),
    Math.sin(x),
    Math.cos(y),
    Math.sin(y),
  ];
  return {
    x: sx * cy * cz - cx * sy * sz,
    y: cx * sy * cz + sx * cy * sz,
    z: cx * cy * sz + sx * sy * cz,
    w: cx * cy * cz - sx * sy * sz,
  };
}

/**
 * Limit events to one per period on average. A fixed pause after each message would lose a part of the rate: of
 * events 16.7 ms apart, every fourth would pass.
 */
export function pacer(period: number): (now: number) => boolean {
  let due = Number.NEGATIVE_INFINITY;
  return (now) => {
    if (now < due) return false;
    due = now - due < period ? due + period : now + period;
    return true;
  };
}

const motion: Sensor = {
  name: "motion",
  type: "sensor_msgs/Imu",
  topic: "imu",
  available: () => "DeviceMotionEvent" in globalThis,
  start: async ({ version, frame, publish }) => {
    const ask = (DeviceMotionEvent as unknown as { requestPermission?: () => Promise<string> })
      .requestPermission;
    if (ask && (await ask()) !== "granted") throw new Error("the browser refuses it");
    let turn: ReturnType<typeof quaternionOf> | null = null;
    const isDue = pacer(PERIOD);
    const turned = ({ alpha, beta, gamma }: DeviceOrientationEvent) => {
      if (alpha !== null && beta !== null && gamma !== null) turn = quaternionOf(alpha, beta, gamma);
    };
    const moved = ({ accelerationIncludingGravity: a, rotationRate: r }: DeviceMotionEvent) => {
      // Devices without these sensors send an event without values.
      if ((a?.x ?? r?.alpha ?? null) === null || !isDue(performance.now())) return;
      const rates = [r?.alpha, r?.beta, r?.gamma];
      const knowsRates = rates.every((rate) => typeof rate === "number");
      // The names are those of the angles, but the axes are not: browsers report alpha about x, beta about y and
      // gamma about z (w3c/deviceorientation#43, #44).
      const [x, y, z] = rates.map((rate) => (rate ?? 0) * RADIANS) as [number, number, number];
      publish({
        header: header(version, frame),
        orientation: turn ?? { x: 0, y: 0, z: 0, w: 1 },
        orientation_covariance: turn ? new Array(9).fill(0) : UNKNOWN,
        angular_velocity: { x, y, z },
        angular_velocity_covariance: knowsRates ? new Array(9).fill(0) : UNKNOWN,
        linear_acceleration: { x: a?.x ?? 0, y: a?.y ?? 0, z: a?.z ?? GRAVITY },
        linear_acceleration_covariance: a ? new Array(9).fill(0) : UNKNOWN,
      });
    };
    addEventListener("deviceorientation", turned);
    addEventListener("devicemotion", moved);
    return () => {
      removeEventListener("deviceorientation", turned);
      removeEventListener("devicemotion", moved);
    };
  },
};

const position: Sensor = {
  name: "position",
  type: "sensor_msgs/NavSatFix",
  topic: "fix",
  available: () => "geolocation" in navigator,
  start: async ({ version, frame, unknown, publish, fail }) => {
    const watch = navigator.geolocation.watchPosition(
      ({ coords, timestamp }) => {
        const variance = coords.accuracy ** 2;
        const up = (coords.altitudeAccuracy ?? coords.accuracy) ** 2;
        publish({
          header: header(version, frame, timestamp),
          status: { status: 0, service: 1 },
          latitude: coords.latitude,
          longitude: coords.longitude,
          altitude: coords.altitude ?? unknown,
          position_covariance: [variance, 0, 0, 0, variance, 0, 0, 0, up],
          position_covariance_type: 1,
        });
      },
      (error) => fail(error.message),
      { enableHighAccuracy: true },
    );
    return () => navigator.geolocation.clearWatch(watch);
  },
};

interface BatteryManager {
  level: number;
  charging: boolean;
}

const battery: Sensor = {
  name: "battery",
  type: "sensor_msgs/BatteryState",
  topic: "battery",
  available: () => "getBattery" in navigator,
  start: async ({ version, frame, unknown, publish }) => {
    const manager = await (
      navigator as unknown as { getBattery: () => Promise<BatteryManager> }
    ).getBattery();
    const tell = () =>
      publish({
        header: header(version, frame),
        voltage: unknown,
        temperature: unknown,
        current: unknown,
        charge: unknown,
        capacity: unknown,
        design_capacity: unknown,
        percentage: manager.level,
        power_supply_status: manager.charging ? 1 : 2,
        present: true,
      });
    tell();
    const timer = setInterval(tell, SLOW);
    return () => clearInterval(timer);
  },
};

const camera: Sensor = {
  name: "camera",
  type: "sensor_msgs/CompressedImage",
  topic: "camera/image/compressed",
  available: () => Boolean(navigator.mediaDevices?.getUserMedia),
  start: async ({ version, frame, publish, fail }) => {
    const stream = await navigator.mediaDevices.getUserMedia({
      video: { width: CAMERA_WIDTH, facingMode: "environment" },
    });
    const video = document.createElement("video");
    video.srcObject = stream;
    video.muted = true;
    video.playsInline = true;
    const stop = () => {
      for (const track of stream.getTracks()) track.stop();
    };
    try {
      await video.play();
    } catch (error) {
      stop();
      throw error;
    }
    const canvas = document.createElement("canvas");
    let busy = false;
    const shoot = async () => {
      if (busy || !video.videoWidth) return;
      busy = true;
      canvas.width = video.videoWidth;
      canvas.height = video.videoHeight;
      canvas.getContext("2d")?.drawImage(video, 0, 0);
      const taken = Date.now();
      const url = canvas.toDataURL("image/jpeg", JPEG_QUALITY);
      publish({
        header: header(version, frame, taken),
        format: "jpeg",
        data: url.slice(url.indexOf(",") + 1),
      });
      busy = false;
    };
    const timer = setInterval(() => shoot().catch((error: Error) => fail(error.message)), CAMERA_PERIOD);
    return () => {
      clearInterval(timer);
      stop();
    };
  },
};

/** Milliseconds after which it is said that nothing is heard. */
const SILENCE = 5000;
/** Octets of a sample: signed, 16 bits, the lower first. */
const SAMPLE_BYTES = 2;

const microphone: Sensor = {
  name: "microphone",
  type: "audio_common_msgs/AudioData",
  topic: "audio/audio",
  description: { type: "audio_common_msgs/AudioInfo", topic: "audio/audio_info" },
  available: () => Boolean(navigator.mediaDevices?.getUserMedia) && "AudioWorkletNode" in globalThis,
  start: async ({ publish, describe, fail }) => {
    const stream = await navigator.mediaDevices.getUserMedia({ audio: { channelCount: 1 } });
    const context = new AudioContext();
    const end = () => {
      for (const track of stream.getTracks()) track.stop();
      void context.close();
    };
    try {
      await context.audioWorklet.addModule(new URL(MICROPHONE_WORKLET, import.meta.url));
    } catch (error) {
      end();
      throw error;
    }
    const worklet = new AudioWorkletNode(context, "microphone", { numberOfOutputs: 0, channelCount: 1 });
    // Without a way to play sound some browsers take none, and do not say so.
    void context.resume();
    const silent = setTimeout(() => fail("the browser gives no sound"), SILENCE);
    worklet.port.onmessage = ({ data }: MessageEvent<ArrayBuffer>) => {
      clearTimeout(silent);
      publish({ data: btoa(String.fromCharCode(...new Uint8Array(data))) });
    };
    context.createMediaStreamSource(stream).connect(worklet);
    const tell = () =>
      describe({
        channels: 1,
        sample_rate: context.sampleRate,
        sample_format: "S16LE",
        bitrate: context.sampleRate * SAMPLE_BYTES * 8,
        coding_format: "WAVE",
      });
    tell();
    // Again and again, for those who come later.
    const timer = setInterval(tell, SLOW);
    return () => {
      clearInterval(timer);
      clearTimeout(silent);
      worklet.port.onmessage = null;
      end();
    };
  },
};

const joystick: Sensor = {
  name: "joystick",
  type: "sensor_msgs/Joy",
  topic: "joy",
  available: () => "getGamepads" in navigator,
  start: async ({ version, frame, publish }) => {
    const timer = setInterval(() => {
      const pad = navigator.getGamepads().find(Boolean);
      // A hidden page sends nothing.
      if (!pad || document.hidden) return;
      publish({
        header: header(version, frame),
        axes: [...pad.axes].map((value) => -value),
        buttons: pad.buttons.map(({ pressed }) => Number(pressed)),
      });
    }, PERIOD);
    return () => clearInterval(timer);
  },
};

export const SENSORS: readonly Sensor[] = [motion, position, battery, camera, microphone, joystick];

/**
 * Start a sensor of this device on a robot; it ends with `signal`.
 *
 * The user may be asked for permission meanwhile. A camera or microphone that is permitted after `signal` is stopped
 * at once.
 *
 * @throws Error it cannot be started; never after `signal`
 */
export async function startSensor(
  session: RobotSession,
  sensor: Sensor,
  namespace: string,
  on: { message: () => void; fail: (text: string) => void },
  signal: AbortSignal,
): Promise<void> {
  const version = session.version.peek();
  const topic = `${namespace}/${sensor.topic}`;
  const typeName = (type: string) => (version === 2 ? type.replace("/", "/msg/") : type);
  const publisher = session.commands.publisher(topic, typeName(sensor.type));
  const { description } = sensor;
  const describer =
    description &&
    session.commands.publisher(`${namespace}/${description.topic}`, typeName(description.type));
  const dispose = () => {
    publisher.dispose();
    describer?.dispose();
  };
  signal.addEventListener("abort", dispose, { once: true });
  try {
    const end = await sensor.start({
      version,
      frame: "device",
      // Other servers have no /role, and rosbridge_suite rejects null for a number.
      unknown: session.permissions.peek().role ? Number.NaN : 0,
      fail: (text) => {
        if (!signal.aborted) on.fail(text);
      },
      publish: (message) => {
        if (signal.aborted) return;
        if (publisher.publishFresh(message)) on.message();
      },
      describe: (message) => describer?.publish(message),
    });
    if (signal.aborted) end();
    else signal.addEventListener("abort", end, { once: true });
  } catch (error) {
    dispose();
    if (!signal.aborted) throw error;
  }
}
