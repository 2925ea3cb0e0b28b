import { afterEach, expect, test, vi } from "vitest";
import { clockText, fixed } from "../src/i18n/formats";

afterEach(() => {
  vi.unstubAllGlobals();
});

test.each([
  ["en-US", "−0.40", "12345.7"],
  ["de-AT", "−0,40", "12345,7"],
])("numbers are written as in %s, with a minus sign and without groups", (language, small, large) => {
  vi.stubGlobal("navigator", { language });
  expect([fixed(-0.4, 2), fixed(12345.67, 1)]).toEqual([small, large]);
  expect(fixed(-0.001, 0)).toBe("0");
});

test.each([
  ["en-US", "13:04:05", "13:04:05.006"],
  ["de-AT", "13:04:05", "13:04:05,006"],
])("a time of day is to 24 hours in %s", (language, whole, exact) => {
  vi.stubGlobal("navigator", { language });
  const time = new Date(2026, 4, 1, 13, 4, 5, 6).getTime();
  expect([clockText(time), clockText(time, 3)]).toEqual([whole, exact]);
  expect(clockText(Number.NaN)).toBe("");
});
