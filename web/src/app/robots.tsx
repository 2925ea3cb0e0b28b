/** The robots of the hub that this page came through: to change to one, or to open it beside this one. */

import { useSignal } from "@preact/signals";
import { Bot, ExternalLink } from "lucide";
import { useEffect } from "preact/hooks";
import { Icon } from "../forms/icon";
import { Menu } from "../forms/menu";
import { Problem } from "../forms/problem";
import { t } from "../i18n/text";

export function RobotMenu({ url }: { url: string }) {
  return (
    <Menu label={t("robots.title")} icon={Bot}>
      {() => <Robots url={new URL(url, location.href)} />}
    </Menu>
  );
}

function Robots({ url }: { url: URL }) {
  const names = useSignal<string[]>([]);
  const problem = useSignal("");
  useEffect(() => {
    fetch(url, { signal: AbortSignal.timeout(10_000) })
      .then(async (response) => {
        const { robots } = (await response.json()) as { robots: { name: string }[] };
        names.value = robots.map(({ name }) => name);
      })
      .catch((error: Error) => {
        problem.value = error.message;
      });
  }, [url.href]);
  if (problem.value) return <Problem text={problem.value} />;
  return (
    <ul>
      {names.value.map((name) => {
        const { href } = new URL(`./${encodeURIComponent(name)}/`, url);
        return (
          <li key={name} class="pair">
            <a href={href} aria-current={location.href.startsWith(href) ? "page" : undefined}>
              {name}
            </a>
            <a href={href} target="_blank" rel="noopener" aria-label={t("robots.beside", { name })}>
              <Icon of={ExternalLink} size={16} />
            </a>
          </li>
        );
      })}
    </ul>
  );
}
