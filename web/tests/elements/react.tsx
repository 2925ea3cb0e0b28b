/** @jsxImportSource react */
/** What the npm package declares for React's TSX compiles, for which `npm run types` is there. Nothing runs it. */

import type {} from "../../package/react";

export function Robot({ onSpeed }: { onSpeed: (speed: number) => void }) {
  return (
    <main>
      <rwt-video topic="/camera/image_raw" details className="camera" />
      <rwt-teleop maxLinear={0.3} keys="page" onrwt-drive={(event) => onSpeed(event.detail.linear)} />
      {/* @ts-expect-error a number is expected */}
      <rwt-teleop maxLinear="fast" />
      <rwt-stop shortcut="Escape" />
      <rwt-scene layers="/map /scan" follow />
      <rwt-map />
      <rwt-plot />
      <rwt-topic topic="/odom" digits={2} />
      <rwt-battery low={20} onrwt-low={({ detail }) => onSpeed(detail.percentage)} />
    </main>
  );
}
