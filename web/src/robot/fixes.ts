/** Positions by satellite (`sensor_msgs/NavSatFix`), and the track that they make. */

import type { Message } from "./subscriptions";

/** Metres of a degree of a great circle, of a sphere with the mean radius of WGS 84. */
const DEGREE = (Math.PI / 180) * 6_371_008.8;
/** Points of a track that are kept; then every second one is dropped. */
const MOST_POINTS = 4000;
/** Metres between two points: receivers that stand report a noisy position. */
const LEAST_STEP = 0.2;

/** Position in degrees and metres above the ellipsoid; `radius` is the standard deviation in metres, if known. */
export interface Fix {
  latitude: number;
  longitude: number;
  altitude: number | null;
  radius: number | null;
}

/** Status of a receiver without a position; -2 says that the driver tells none. */
const NO_FIX = -1;

/** The position in a message; null if the receiver has none. */
export function fixOf(message: Message): Fix | null {
  const { latitude, longitude, altitude, position_covariance } = message;
  const { status } = (message.status ?? {}) as { status?: unknown };
  if (status === NO_FIX) return null;
  if (typeof latitude !== "number" || typeof longitude !== "number") return null;
  if (!(Math.abs(latitude) <= 90 && Math.abs(longitude) <= 180)) return null;
  const variances = (position_covariance ?? []) as ArrayLike<number>;
  const radius = Math.sqrt(Math.max(Number(variances[0]), Number(variances[4])));
  const isKnown = Number(message.position_covariance_type) > 0 && Number.isFinite(radius);
  return {
    latitude,
    longitude,
    altitude: typeof altitude === "number" && Number.isFinite(altitude) ? altitude : null,
    radius: isKnown ? radius : null,
  };
}

/** Metres east and north of the first position of a track. */
export type Point = readonly [east: number, north: number];

/** Positions in a plane that touches the earth at the first one: 1 % of error 80 km from it at 50° of latitude. */
export class Track {
  points: Point[] = [];
  /** Metres along all points. */
  length = 0;
  private origin: Fix | null = null;

  /** Add a position; returns where it is. */
  add(fix: Fix): Point {
    this.origin ??= fix;
    const { latitude, longitude } = this.origin;
    const degrees = ((fix.longitude - longitude + 540) % 360) - 180;
    const point: Point = [
      degrees * DEGREE * Math.cos((latitude * Math.PI) / 180),
      (fix.latitude - latitude) * DEGREE,
    ];
    const last = this.points.at(-1);
    const step = last ? Math.hypot(point[0] - last[0], point[1] - last[1]) : 0;
    if (!last || step >= LEAST_STEP) {
      this.points.push(point);
      this.length += step;
    }
    if (this.points.length > MOST_POINTS) {
      this.points = this.points.filter((_, at) => at % 2 === 0 || at === this.points.length - 1);
    }
    return point;
  }
}
