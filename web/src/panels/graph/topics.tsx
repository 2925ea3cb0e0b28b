/** Topics: a list with rate, bandwidth and age, the last message as a tree, and a form to publish one. */

import { useComputed, useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Check, NameButton, Search } from "../../forms/inputs";
import { MessageForm } from "../../forms/message_form";
import { MessageTree, shortValue } from "../../forms/message_tree";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { selectedFields } from "../../robot/fields";
import { shortType } from "../../robot/names";
import type { Message } from "../../robot/subscriptions";
import type { Definitions } from "../../robot/typedefs";
import { componentPanel, now, Refusal, useMessages } from "../component";
import type { PanelContext, PanelKind } from "../registry";

/** Rows of the list at a time: a robot may have ten thousand topics. */
const MOST_ROWS = 200;
/** Milliseconds between two messages that are shown: people read no faster. */
const THROTTLE = 200;

export const topics: PanelKind = {
  name: "topics",
  title: "topics.title",
  supportedTypes: [],
  opens: () => true,
  place: "below",
  init: componentPanel(TopicsPanel),
};

function TopicsPanel({ context }: { context: PanelContext }) {
  const { session, config } = context;
  const search = useSignal("");
  const chosen = String(config.value.topic ?? "");
  const found = useComputed(() => {
    const wanted = search.value.toLowerCase();
    return [...session.graph.value.topics]
      .filter(([name, type]) => `${name} ${type}`.toLowerCase().includes(wanted))
      .sort(([one], [other]) => (one < other ? -1 : 1));
  });
  const shown = found.value.slice(0, MOST_ROWS);
  const names = shown.map(([name]) => name);
  const isVisible = context.visible.value;
  useEffect(
    () => (isVisible ? session.rates.watch(names) : undefined),
    [session, isVisible, names.join("\n")],
  );
  return (
    <div class="split">
      <div class="list">
        <Search text={search} />
        <table class="topic-table">
          <thead>
            <tr>
              <th scope="col">{t("layout.name")}</th>
              <th scope="col" class="type">
                {t("topics.type")}
              </th>
              <th scope="col" class="rate">
                {t("topics.rate")}
              </th>
              <th scope="col" class="bandwidth">
                {t("topics.bandwidth")}
              </th>
            </tr>
          </thead>
          <tbody>
            {shown.map(([name, type]) => (
              <tr key={name} class={name === chosen ? "chosen" : ""}>
                <td>
                  <NameButton
                    name={name}
                    title={`${name} · ${type}`}
                    chosen={name === chosen}
                    onChoose={() => {
                      config.value = { ...config.value, topic: name };
                    }}
                  />
                </td>
                <td class="faint type" title={type}>
                  <ShortType type={type} />
                </td>
                <Traffic context={context} name={name} />
              </tr>
            ))}
          </tbody>
        </table>
        {found.value.length > shown.length && (
          <p class="faint">{t("topics.more", { count: found.value.length - shown.length })}</p>
        )}
      </div>
      <div class="detail">
        {chosen ? (
          <OneTopic key={chosen} context={context} name={chosen} />
        ) : (
          <p class="faint">{t("topics.choose")}</p>
        )}
      </div>
    </div>
  );
}

/** A type, whose package goes first where there is no room. */
function ShortType({ type }: { type: string }) {
  const short = shortType(type);
  const slash = short.indexOf("/") + 1;
  return (
    <>
      <span class="package">{short.slice(0, slash)}</span>
      {short.slice(slash)}
    </>
  );
}

/** Rate of a topic; empty while it is not known. */
export function rateText({ rates, traffic }: PanelContext["session"], name: string): string {
  const received = traffic.value.get(name);
  const hz = rates.known.value.get(name)?.hz ?? (received ? received.messages / received.seconds : null);
  if (hz === null) return "";
  return hz === 0 ? t("topics.idle") : `${hz < 99.95 ? fixed(hz, 1) : fixed(hz, 0)} Hz`;
}

function Traffic({ context, name }: { context: PanelContext; name: string }) {
  const { session } = context;
  const traffic = session.traffic.value.get(name);
  return (
    <>
      <td class="number rate">{rateText(session, name)}</td>
      <td class="number bandwidth">
        {traffic && `${fixed(traffic.bytes / traffic.seconds / 1000, 1)} kB/s`}
      </td>
    </>
  );
}

function OneTopic({ context, name }: { context: PanelContext; name: string }) {
  const { session, visible } = context;
  const type = session.graph.value.topics.get(name) ?? "";
  const last = useSignal<{ message: Message; at: number } | null>(null);
  const mayHear = session.may("subscribe", name);
  const take = (message: Message) => {
    last.value = { message, at: Date.now() };
  };
  useMessages(session, name, take, { throttle: THROTTLE, isOn: visible.value });
  const age = last.value ? Math.max(0, (now.value - last.value.at) / 1000) : null;
  return (
    <>
      <h2>{name}</h2>
      <p class="faint">
        {type} {age !== null && `· ${t("topics.age")} ${fixed(age, 0)} s`}
      </p>
      {!mayHear && <Refusal context={context} act="subscribe" name={name} />}
      {mayHear &&
        (last.value ? <LastMessage message={last.value.message} /> : <p>{t("panel.waiting", { name })}</p>)}
      {session.isRecording ? null : session.may("publish", name) ? (
        <PublishForm context={context} name={name} type={type} />
      ) : (
        <Refusal context={context} act="publish" name={name} />
      )}
    </>
  );
}

/** The last message: the whole as a tree, or fields by their names, or what differs from a message kept before. */
function LastMessage({ message }: { message: Message }) {
  const text = useSignal("");
  const earlier = useSignal<Message | undefined>(undefined);
  const isWhole = !text.value && !earlier.value;
  const fields = isWhole ? [] : selectedFields(message, text.value, earlier.value);
  return (
    <>
      <div class="plot-bar">
        <Search text={text} name={t("topics.filter")} />
        <Check
          checked={earlier.value !== undefined}
          onChange={(on) => {
            earlier.value = on ? message : undefined;
          }}
        >
          {t("topics.compare")}
        </Check>
      </div>
      {isWhole ? (
        <MessageTree value={message} />
      ) : (
        <dl class="fields">
          {fields.map((field) => (
            <div key={field.path}>
              <dt>{field.path}</dt>
              <dd>
                {earlier.value && field.earlier !== undefined && (
                  <>
                    <del>{shortValue(field.earlier)}</del> →{" "}
                  </>
                )}
                <code>{shortValue(field.value)}</code>
              </dd>
            </div>
          ))}
        </dl>
      )}
      {!isWhole && !fields.length && (
        <p class="faint">{t(earlier.value ? "topics.no_difference" : "topics.no_field")}</p>
      )}
    </>
  );
}

function PublishForm({ context, name, type }: { context: PanelContext; name: string; type: string }) {
  const { session } = context;
  const open = useSignal(false);
  const definitions = useSignal<Definitions | null>(null);
  const value = useSignal<Message>({});
  const whole = useSignal(true);
  const problem = useSignal("");
  const done = useSignal(0);
  const unfold = async (event: Event) => {
    open.value = (event.currentTarget as HTMLDetailsElement).open;
    if (!open.value || definitions.value) return;
    try {
      const found = await session.define("message", type);
      value.value = found.empty();
      definitions.value = found;
    } catch (error) {
      problem.value = (error as Error).message;
    }
  };
  return (
    <details onToggle={unfold}>
      <summary>{t("topics.publish")}</summary>
      {problem.value && <Problem text={problem.value} />}
      {definitions.value && (
        <form
          onSubmit={(event) => {
            event.preventDefault();
            if (!whole.value) return;
            const publisher = session.commands.publisher(name, type);
            if (publisher.publish(value.value)) done.value++;
            // In order behind the message: the robot has it before the advertisement ends.
            publisher.dispose();
          }}
        >
          <MessageForm
            definitions={definitions.value}
            value={value.value}
            onChange={(next, isWhole) => {
              value.value = next;
              whole.value = isWhole;
            }}
          />
          <Commanding session={session}>
            <button type="submit" disabled={!whole.value}>
              {t("topics.publish")}
            </button>
          </Commanding>
          <span role="status">{done.value > 0 && t("topics.published")}</span>
        </form>
      )}
    </details>
  );
}
