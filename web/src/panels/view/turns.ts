/**
 * Plots draw in turns. Without a graphics card, a browser paints each canvas on the page's thread, so that many plots
 * would leave no time for anything else: as many draw in a frame as let the next one come in time.
 */

/** Milliseconds between two pictures of one plot. */
const PERIOD = 50;
/** Milliseconds from frame to frame above which fewer plots draw, and below which more do. */
const LONG = 25;
const SHORT = 18;

/** Time at which each plot has drawn last; the one that waits longest is the first. */
const plots = new Map<() => void, number>();
let share = 1;
let before = 0;
let isScheduled = false;

function schedule(): void {
  if (isScheduled || !plots.size) return;
  isScheduled = true;
  requestAnimationFrame(frame);
}

function frame(now: number): void {
  isScheduled = false;
  const took = now - before;
  before = now;
  if (took > LONG) share = Math.max(1, share - 1);
  else if (took < SHORT) share = Math.min(share + 1, plots.size);
  let left = share;
  for (const [redraw, at] of plots) {
    if (left-- === 0 || now - at < PERIOD) break;
    plots.delete(redraw);
    plots.set(redraw, now);
    redraw();
  }
  schedule();
}

/** Call `redraw` again and again, when it is its turn, until the returned function is called. */
export function drawInTurn(redraw: () => void): () => void {
  plots.set(redraw, 0);
  schedule();
  return () => plots.delete(redraw);
}
