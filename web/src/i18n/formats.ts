/** Times and numbers as the user's browser writes them. */

/** How a time of day is written, with so many digits of its second; always to 24 hours, as robots' logs are. */
function clockWith(digits: 0 | 1 | 2 | 3): Intl.DateTimeFormat {
  return new Intl.DateTimeFormat(navigator.language, {
    hour: "2-digit",
    minute: "2-digit",
    second: "2-digit",
    hourCycle: "h23",
    ...(digits && { fractionalSecondDigits: digits }),
  });
}

const clocks = new Map<string, Intl.DateTimeFormat>();

/** A time of day; `time` is milliseconds since 1970. Empty for what is no time. */
export function clockText(time: number, digits: 0 | 1 | 2 | 3 = 0): string {
  const key = `${navigator.language} ${digits}`;
  let clock = clocks.get(key);
  if (!clock) {
    clock = clockWith(digits);
    clocks.set(key, clock);
  }
  // Dates end at 100 million days.
  return Math.abs(time) <= 8.64e15 ? clock.format(time) : "";
}

const numbers = new Map<string, Intl.NumberFormat>();

/** A number with so many decimals, and a real minus sign. */
export function fixed(value: number, digits: number): string {
  const key = `${navigator.language} ${digits}`;
  let format = numbers.get(key);
  if (!format) {
    const range = { minimumFractionDigits: digits, maximumFractionDigits: digits };
    format = new Intl.NumberFormat(navigator.language, {
      ...range,
      useGrouping: false,
      signDisplay: "negative",
    });
    numbers.set(key, format);
  }
  return format.format(value).replace("-", "−");
}
