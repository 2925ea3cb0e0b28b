/** Setting of the draw quality: automatic, low, or full. */
export type Quality = "auto" | "low" | "high";

export const QUALITIES: readonly Quality[] = ["auto", "low", "high"];
