/** Services and actions: forms made from their types, and what comes back. */

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Commanding } from "../../forms/commanding";
import { Check, NameButton, Search } from "../../forms/inputs";
import { MessageForm } from "../../forms/message_form";
import { MessageTree } from "../../forms/message_tree";
import { Problem } from "../../forms/problem";
import { fixed } from "../../i18n/formats";
import { t } from "../../i18n/text";
import { keepAsking } from "../../robot/asking";
import type { GoalHandle } from "../../robot/goals";
import type { Message } from "../../robot/subscriptions";
import type { Definitions } from "../../robot/typedefs";
import { componentPanel, Refusal } from "../component";
import type { PanelContext, PanelKind } from "../registry";

/** Milliseconds to wait for a service. */
const PATIENCE = 30_000;
/** Services that every node has, and those of the bridge itself: shown on request. */
const INFRASTRUCTURE =
  /^\/rosapi\/|\/(describe_parameters|get_parameter_types|get_parameters|list_parameters|set_parameters|set_parameters_atomically|get_type_description|get_loggers|set_logger_level)$|\/_action\//;
const MOST_ROWS = 200;

export const services: PanelKind = {
  name: "services",
  title: "services.title",
  supportedTypes: [],
  opens: (session) => session.graph.value.services.some((name) => !INFRASTRUCTURE.test(name)),
  place: "below",
  init: componentPanel(ServicesPanel),
};

export const actions: PanelKind = {
  name: "actions",
  title: "actions.title",
  supportedTypes: [],
  opens: (session) => session.graph.value.actions.length > 0,
  place: "below",
  init: componentPanel(ActionsPanel),
};

function ServicesPanel({ context }: { context: PanelContext }) {
  const all = useSignal(false);
  const names = context.session.graph.value.services.filter(
    (name) => all.value || !INFRASTRUCTURE.test(name),
  );
  return (
    <Chooser
      context={context}
      names={names}
      extra={
        <Check
          checked={all.value}
          onChange={(checked) => {
            all.value = checked;
          }}
        >
          {t("services.all")}
        </Check>
      }
    >
      {(name) => <OneService key={name} context={context} name={name} />}
    </Chooser>
  );
}

function ActionsPanel({ context }: { context: PanelContext }) {
  return (
    <Chooser context={context} names={context.session.graph.value.actions}>
      {(name) => <OneAction key={name} context={context} name={name} />}
    </Chooser>
  );
}

function Chooser(props: {
  context: PanelContext;
  names: readonly string[];
  extra?: preact.ComponentChild;
  children: (name: string) => preact.ComponentChild;
}) {
  const { context, names, extra, children } = props;
  const { config } = context;
  const search = useSignal("");
  const chosen = String(config.value.name ?? "");
  const found = [...names].filter((name) => name.toLowerCase().includes(search.value.toLowerCase())).sort();
  return (
    <div class="split">
      <div class="list">
        <Search text={search} />
        {extra}
        <ul class="names">
          {found.slice(0, MOST_ROWS).map((name) => (
            <li key={name} class={name === chosen ? "chosen" : ""}>
              <NameButton
                name={name}
                chosen={name === chosen}
                onChoose={() => {
                  config.value = { ...config.value, name };
                }}
              />
            </li>
          ))}
        </ul>
        {found.length > MOST_ROWS && (
          <p class="faint">{t("topics.more", { count: found.length - MOST_ROWS })}</p>
        )}
      </div>
      <div class="detail">{chosen ? children(chosen) : <p class="faint">{t("calls.choose")}</p>}</div>
    </div>
  );
}

/** The type of a service, and the definition of its request. */
async function requestOf(context: PanelContext, name: string): Promise<[string, Definitions]> {
  const { session } = context;
  const { type } = await session.call<{ type: string }>("/rosapi/service_type", { service: name });
  return [type, await session.define("request", type)];
}

/** The type of an action, and the definition of its goal. */
async function goalOf(context: PanelContext, name: string): Promise<[string, Definitions]> {
  const { session } = context;
  if (session.version.peek() === 2) {
    const { type } = await session.call<{ type: string }>("/rosapi/action_type", { action: name });
    return [type, await session.define("goal", type)];
  }
  // actionlib has no types of actions: they are those of its topics.
  const topicType = session.graph.peek().topics.get(`${name}/goal`) ?? "";
  const bare = topicType.replace(/ActionGoal$/, "");
  return [`${bare}Action`, await session.define("message", `${bare}Goal`)];
}

/** A form for what is sent, once its type is known. */
function useForm({ session }: PanelContext, load: () => Promise<[string, Definitions]>) {
  const state = useSignal<{ type: string; definitions: Definitions } | null>(null);
  const value = useSignal<Message>({});
  const whole = useSignal(true);
  const problem = useSignal("");
  // What there is tells which generation of ROS is asked, and by which type.
  const { hasAsked } = session;
  // A form is made once, and stays as it is filled in; another name is another form.
  useEffect(() => {
    if (!hasAsked) return undefined;
    const end = keepAsking(
      session,
      load,
      ([type, definitions]) => {
        end();
        value.value = definitions.empty();
        state.value = { type, definitions };
      },
      (reason) => {
        problem.value = reason;
      },
    );
    return end;
  }, [session, hasAsked]);
  const form = state.value && (
    <MessageForm
      definitions={state.value.definitions}
      value={value.value}
      onChange={(next, isWhole) => {
        value.value = next;
        whole.value = isWhole;
      }}
    />
  );
  return { form, type: state.value?.type ?? "", value, whole, problem };
}

function OneService({ context, name }: { context: PanelContext; name: string }) {
  const { session } = context;
  const { form, type, value, whole, problem } = useForm(context, () => requestOf(context, name));
  const busy = useSignal(false);
  const answer = useSignal<{ values: Message; took: number } | null>(null);
  if (!session.may("call", name)) return <Refusal context={context} act="call" name={name} />;
  const call = async (event: Event) => {
    event.preventDefault();
    busy.value = true;
    problem.value = "";
    answer.value = null;
    const began = performance.now();
    try {
      const values = await session.commands.call(name, value.value, type, PATIENCE);
      answer.value = { values, took: performance.now() - began };
    } catch (error) {
      problem.value = (error as Error).message;
    }
    busy.value = false;
  };
  return (
    <form onSubmit={call}>
      <h2>{name}</h2>
      <p class="faint">{type}</p>
      {form}
      <Commanding session={session}>
        <button type="submit" disabled={busy.value || !whole.value || !type}>
          {busy.value ? t("services.busy") : t("services.call")}
        </button>
      </Commanding>
      {problem.value && <Problem text={problem.value} />}
      {answer.value && (
        <div role="status">
          <p class="faint">{t("services.answer", { milliseconds: fixed(answer.value.took, 0) })}</p>
          <MessageTree value={answer.value.values} />
        </div>
      )}
    </form>
  );
}

function OneAction({ context, name }: { context: PanelContext; name: string }) {
  const { session } = context;
  const { form, type, value, whole, problem } = useForm(context, () => goalOf(context, name));
  const goal = useSignal<GoalHandle | null>(null);
  const feedback = useSignal<Message | null>(null);
  const end = useSignal<{ outcome: string; text: string; result: Message } | null>(null);
  if (!session.may("goals", name)) return <Refusal context={context} act="goals" name={name} />;
  const send = (event: Event) => {
    event.preventDefault();
    feedback.value = end.value = null;
    if (!session.commands.mayCommand(name, "goals")) return;
    const sent = session.commands.sendGoal(name, type, value.value, {
      onFeedback: (message) => {
        feedback.value = message;
      },
    });
    goal.value = sent;
    void sent.outcome.then((last) => {
      if (goal.value === sent) goal.value = null;
      end.value = last;
    });
  };
  return (
    <form onSubmit={send}>
      <h2>{name}</h2>
      <p class="faint">{type}</p>
      {form}
      <Commanding session={session}>
        <button type="submit" disabled={goal.value !== null || !whole.value || !type}>
          {t("actions.send")}
        </button>
      </Commanding>
      {goal.value && (
        <button type="button" onClick={() => goal.value?.cancel()}>
          {t("goal.cancel")}
        </button>
      )}
      {problem.value && <Problem text={problem.value} />}
      {end.value && (
        <div role="status">
          <p class={end.value.outcome === "succeeded" ? "good" : "problem"}>
            {t(`outcome.${end.value.outcome as "succeeded"}`)} {end.value.text}
          </p>
          <MessageTree value={end.value.result} />
        </div>
      )}
      {feedback.value && (
        <>
          <h3>{t("actions.feedback")}</h3>
          <MessageTree value={feedback.value} />
        </>
      )}
    </form>
  );
}
