/** A form for a message of any type: made from the type's definition, as the robot tells it. */

import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { useEffect } from "preact/hooks";
import { t } from "../i18n/text";
import {
  type Definitions,
  type Field,
  integerRange,
  isBoolean,
  isNumber,
  namedValues,
  numberOf,
  type TypeDefinition,
  valueError,
} from "../robot/typedefs";
import { Check, Choice } from "./inputs";

type Values = Record<string, unknown>;

/**
 * The fields of a message. What is typed in and is no value of its field stays in the form and is said beside it;
 * then `onChange` is told that the message is not whole.
 */
export function MessageForm(props: {
  definitions: Definitions;
  value: Values;
  onChange: (value: Values, whole: boolean) => void;
}) {
  const wrong = useSignal(new Set<string>());
  const { definitions, value, onChange } = props;
  if (definitions.root.fields.length === 0) return <p class="faint">{t("form.empty")}</p>;
  return (
    <div class="message-form">
      <Fields
        definitions={definitions}
        definition={definitions.root}
        value={value}
        path=""
        onChange={(next) => onChange(next, wrong.value.size === 0)}
        onWrong={(path, isWrong) => {
          if (isWrong === wrong.value.has(path)) return;
          const next = new Set(wrong.value);
          if (isWrong) next.add(path);
          else next.delete(path);
          wrong.value = next;
          onChange(value, next.size === 0);
        }}
      />
    </div>
  );
}

interface Part {
  definitions: Definitions;
  path: string;
  onWrong: (path: string, isWrong: boolean) => void;
}

function Fields(
  props: Part & { definition: TypeDefinition; value: Values; onChange: (value: Values) => void },
) {
  const { definition, value, onChange, path, ...rest } = props;
  return (
    <>
      {definition.fields.map((field) => (
        <FieldInput
          {...rest}
          key={field.name}
          definition={definition}
          field={field}
          path={`${path}/${field.name}`}
          value={value[field.name]}
          onChange={(next) => onChange({ ...value, [field.name]: next })}
        />
      ))}
    </>
  );
}

type Input = Part & {
  definition: TypeDefinition;
  field: Field;
  value: unknown;
  onChange: (value: unknown) => void;
};

function FieldInput(props: Input) {
  const { field } = props;
  if (field.length !== null) return <ListInput {...props} />;
  return <ItemInput {...props} />;
}

function ListInput(props: Input) {
  const { definitions, field, value, onChange, path } = props;
  const items = Array.isArray(value) ? value : [];
  const fixed = (field.length ?? 0) > 0;
  return (
    <fieldset>
      <legend>
        {field.name} <span class="faint">{`${field.type}[${fixed ? field.length : ""}]`}</span>
      </legend>
      {items.map((item, at) => (
        <div class="item" key={at}>
          <ItemInput
            {...props}
            field={{ ...field, name: `${field.name} ${at}` }}
            path={`${path}/${at}`}
            value={item}
            onChange={(next) => onChange(items.map((each, index) => (index === at ? next : each)))}
          />
          {!fixed && (
            <button
              type="button"
              aria-label={t("form.remove", { name: `${field.name} ${at}` })}
              onClick={() => onChange(items.filter((_, index) => index !== at))}
            >
              ×
            </button>
          )}
        </div>
      ))}
      {!fixed && (
        <button type="button" onClick={() => onChange([...items, definitions.emptyItem(field)])}>
          {t("form.add", { name: field.name })}
        </button>
      )}
    </fieldset>
  );
}

function ItemInput(props: Input) {
  const { definitions, definition, field, value, onChange } = props;
  const nested = definitions.find(field.type);
  if (nested) {
    return (
      <fieldset>
        <legend>
          {field.name} <span class="faint">{nested.type}</span>
        </legend>
        <Fields
          {...props}
          definition={nested}
          value={(value as Values | undefined) ?? {}}
          onChange={onChange}
        />
      </fieldset>
    );
  }
  if (isBoolean(field.type)) {
    return (
      <Check checked={value === true} onChange={onChange}>
        {field.name}
      </Check>
    );
  }
  const names = namedValues(definition, field);
  const label = (
    <span>
      {field.name} <span class="faint">{field.type}</span>
    </span>
  );
  if (!names.length) return <TextInput {...props} label={label} />;
  const options = names.map((each) => [String(each.value), `${each.name} (${each.value})`] as const);
  const all = names.some((each) => each.value === value) ? options : [String(value), ...options];
  return (
    <Choice label={label} chosen={String(value)} options={all} onChoose={(next) => onChange(Number(next))} />
  );
}

function TextInput(props: Input & { label: JSX.Element }) {
  const { field, value, onChange, onWrong, path, label } = props;
  const text = useSignal(typeof value === "object" ? JSON.stringify(value) : String(value ?? ""));
  const problem = valueError(field.type, text.value);
  // A field that goes away is wrong no more.
  useEffect(() => () => onWrong(path, false), []);
  const [least, most] = integerRange(field.type) ?? [0, 0];
  const id = `problem ${path}`;
  return (
    <label>
      {label}
      <input
        type="text"
        inputMode={isNumber(field.type) ? "decimal" : "text"}
        value={text.value}
        aria-invalid={problem !== null}
        aria-describedby={problem ? id : undefined}
        onInput={(event) => {
          text.value = event.currentTarget.value;
          const wrong = valueError(field.type, text.value);
          onWrong(path, wrong !== null);
          if (!wrong) onChange(isNumber(field.type) ? numberOf(text.value) : text.value);
        }}
      />
      {problem && (
        <span class="problem" id={id}>
          {t(`form.${problem}`, { least: String(least), most: String(most) })}
        </span>
      )}
    </label>
  );
}
