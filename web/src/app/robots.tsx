/** The robots of the hub that this page came through: to change to one, or to open it beside this one. */

import { useSignal } from "@preact/signals";
import { Bot, ExternalLink } from "lucide";
import { Icon } from "../forms/icon";
import { useLater } from "../forms/later";
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
  const problem = useLater(
    async () => (await fetch(url, { signal: AbortSignal.timeout(10_000) })).json(),
    ({ robots }: { robots: { name: string }[] }) => {
      names.value = robots.map(({ name }) => name);
      return undefined;
    },
    [url.href],
  );
  if (problem) return <Problem text={problem} />;
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
