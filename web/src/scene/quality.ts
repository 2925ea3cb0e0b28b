/** How finely a scene is to be drawn: what the machine manages, little, or everything. */
export type Quality = "auto" | "low" | "high";

export const QUALITIES: readonly Quality[] = ["auto", "low", "high"];
