/** Controls of the recording that the page plays in place of a robot. */

import { useSignal } from "@preact/signals";
import { BookmarkPlus, Pause, Play, Repeat, X } from "lucide";
import { useEffect } from "preact/hooks";
import { PLAYBACK, type Playback } from "../decode/protocol";
import { Icon } from "../forms/icon";
import { Choice } from "../forms/inputs";
import { t } from "../i18n/text";
import type { App } from "./state";

const RATES = [0.1, 0.25, 0.5, 1, 2, 5, 10];
/** Seconds that an arrow key goes. */
const STEP = 0.1;

/** Time since the start of a recording. */
export function timeText(seconds: number): string {
  const tenths = Math.round(Math.max(0, seconds) * 10);
  const minutes = Math.floor(tenths / 600);
  const rest = ((tenths % 600) / 10).toFixed(1).padStart(4, "0");
  if (minutes < 60) return `${minutes}:${rest}`;
  return `${Math.floor(minutes / 60)}:${String(minutes % 60).padStart(2, "0")}:${rest}`;
}

export function Timeline({ app }: { app: App }) {
  const { session } = app;
  const playback = useSignal<Playback | null>(null);
  /** Seconds since the start. */
  const bookmarks = useSignal<readonly number[]>([]);
  useEffect(
    () =>
      session.subscribe(PLAYBACK, "", (message) => {
        playback.value = message as unknown as Playback;
      }),
    [session, playback],
  );
  const state = playback.value;
  if (!state) return null;
  const { begin, end, time, paused, rate, loop } = state;
  const change = async (wanted: Partial<Playback>) => {
    try {
      playback.value = await session.call<Playback>(PLAYBACK, wanted);
    } catch (error) {
      session.note("error", (error as Error).message, PLAYBACK);
    }
  };
  const at = time - begin;
  const button = (icon: typeof X, name: string, act: () => void, pressed?: boolean) => (
    <button type="button" title={name} aria-label={name} aria-pressed={pressed} onClick={act}>
      <Icon of={icon} />
    </button>
  );
  const mark = () => {
    const all = new Set([...bookmarks.value, Math.round(at * 10) / 10]);
    bookmarks.value = [...all].sort((one, other) => one - other);
  };
  const unmark = (mark: number) => {
    bookmarks.value = bookmarks.value.filter((other) => other !== mark);
  };
  return (
    <section class="timeline" aria-label={t("recording.title")}>
      {button(paused ? Play : Pause, t(paused ? "player.resume" : "plot.pause"), () =>
        change({ paused: !paused }),
      )}
      <input
        type="range"
        aria-label={t("plot.time")}
        aria-valuetext={timeText(at)}
        min={0}
        max={end - begin}
        step={STEP}
        value={at}
        list="bookmarks"
        onInput={(event) => change({ time: begin + Number(event.currentTarget.value) })}
      />
      <datalist id="bookmarks">
        {bookmarks.value.map((each) => (
          <option key={each} value={each} />
        ))}
      </datalist>
      <span class="number" title={new Date(time * 1000).toLocaleString()}>
        {timeText(at)} / {timeText(end - begin)}
      </span>
      <Choice
        label={t("player.rate")}
        quiet
        chosen={String(rate)}
        options={RATES.map((each) => [String(each), `${each}×`])}
        onChoose={(value) => change({ rate: Number(value) })}
      />
      {button(Repeat, t("recording.loop"), () => change({ loop: !loop }), loop)}
      {button(BookmarkPlus, t("recording.mark"), mark)}
      {bookmarks.value.map((each) => (
        <span key={each} class="bookmark">
          <button
            type="button"
            aria-label={t("recording.go", { time: timeText(each) })}
            onClick={() => change({ time: begin + each })}
          >
            {timeText(each)}
          </button>
          {button(X, t("recording.unmark", { time: timeText(each) }), () => unmark(each))}
        </span>
      ))}
      <p role="status">{t("recording.only")}</p>
      <button type="button" onClick={() => location.reload()}>
        {t("recording.back")}
      </button>
    </section>
  );
}
