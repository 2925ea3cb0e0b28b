"""The page of the HTTP gateway, in a browser: it lists what is there, calls, publishes and follows."""

from __future__ import annotations

from typing import Any

import pytest

from tests.browser.driver import Browser
from tests.browser.stand import stand

pytestmark = [pytest.mark.anyio, pytest.mark.browser]

OPEN = """(() => {{
  const details = document.querySelector('details[data-operation="{0}"]');
  details.open = true;
  return details !== null;
}})()"""
PRESS = """(() => {{
  const details = document.querySelector('details[data-operation="{0}"]');
  const body = details.querySelector('textarea');
  if (body) body.value = {1};
  details.querySelector('{2}').click();
  return true;
}})()"""
SAYS = "document.querySelector('details[data-operation=\"{0}\"] pre').textContent.includes({1})"


async def test_a_person_can_try_it(browser: Browser) -> None:
    heard: list[Any] = []
    async with stand("jazzy", browser.built, robot=False) as served, browser.page(f"{served.url}api") as page:
        served.node.advertise("/label", "std_msgs/String", latch=True).publish({"data": "it is <here>"})
        served.node.subscribe("/twist", heard.append, "geometry_msgs/Twist")
        served.node.advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda it: {"sum": it.a + it.b}
        )
        await page.goto(f"{served.url}api")
        await page.wait("document.querySelector('#operations').dataset.loaded === 'true'")

        assert await page.evaluate(OPEN.format("call_add"))
        await page.wait("document.querySelector('details[data-operation=\"call_add\"] form')")
        await page.evaluate(PRESS.format("call_add", '\'{"a": 40, "b": 2}\'', "button"))
        await page.wait(SAYS.format("call_add", "'\"sum\": 42'"))

        await page.evaluate(OPEN.format("get_label"))
        await page.wait("document.querySelector('details[data-operation=\"get_label\"] form')")
        await page.evaluate(PRESS.format("get_label", "''", "button[value=follow]"))
        await page.wait(SAYS.format("get_label", "'it is <here>'"))

        await page.evaluate(OPEN.format("publish_twist"))
        await page.wait("document.querySelector('details[data-operation=\"publish_twist\"] form')")
        example = await page.evaluate(
            "document.querySelector('details[data-operation=\"publish_twist\"] textarea').value"
        )
        assert '"angular"' in str(example)
        await page.evaluate(PRESS.format("publish_twist", '\'{"linear": {"x": 0.5}}\'', "button"))
        await page.wait(SAYS.format("publish_twist", "'204'"))
        assert heard[0].linear.x == 0.5
