// A scene of ros3d with what the page's address asks for: scene.html?show=map,scan&camera=0,-1,20

const number = (text) => text.split(',').map(Number);
const [x, y, z] = number(asked.get('camera') ?? '0,-0.1,12');
const viewer = new ROS3D.Viewer({
  divID: 'scene',
  width: 500,
  height: 400,
  antialias: false,
  background: '#101010',
  cameraPose: { x, y, z },
  displayPanAndZoomFrame: false,
});
const [cx, cy, cz] = number(asked.get('center') ?? '0,0,0');
viewer.cameraControls.center.set(cx, cy, cz);

const tfClient = new ROSLIB.TFClient({
  ros,
  fixedFrame: asked.get('frame') ?? 'map',
  angularThres: 0.01,
  transThres: 0.01,
  rate: 20,
});
const scene = viewer.scene;
const common = { ros, tfClient, rootObject: scene };
const show = {
  grid: () => viewer.addObject(new ROS3D.Grid({ color: '#335533', num_cells: 10 })),
  map: () => new ROS3D.OccupancyGridClient({ ...common, continuous: true, opacity: 1 }),
  scan: () => new ROS3D.LaserScan({ ...common, topic: '/scan', material: { size: 0.2, color: 0xff00ff } }),
  cloud: () => new ROS3D.PointCloud2({
    ...common, topic: '/cloud', max_pts: 20000, material: { size: 0.1 },
  }),
  robot: () => new ROS3D.UrdfClient({ ...common, path: `${location.origin}/packages/` }),
  axes: () => new ROS3D.TFAxes({ ...common, frame_id: asked.get('axes'), shaftRadius: 0.1, headRadius: 0.2 }),
  marker: () => new ROS3D.MarkerClient({ ...common, topic: '/marker' }),
  markers: () => new ROS3D.MarkerArrayClient({ ...common, topic: '/markers' }),
  handles: () => new ROS3D.InteractiveMarkerClient({
    ros, tfClient, topic: asked.get('handles') ?? '/goal_marker', camera: viewer.camera,
    rootObject: viewer.selectableObjects,
  }),
  depthcloud: () => {
    const cloud = new ROS3D.DepthCloud({
      url: asked.get('stream'),
      streamType: asked.get('type'),
      f: Number(asked.get('f')),
      maxDepthPerTile: Number(asked.get('tile')),
      width: 256,
      height: 256,
      pointSize: 4,
    });
    // Firefox tells of each picture of MJPEG that it has loaded, and DepthCloud then makes all its points once more.
    const begin = cloud.initStreamer;
    cloud.initStreamer = () => {
      cloud.initStreamer = () => undefined;
      begin.call(cloud);
    };
    if (!cloud.isMjpeg) {
      // DepthCloud looks at new pictures only when the player could play to the end, and of a live video Chromium
      // seldom believes that.
      const renew = () => {
        cloud.texture.needsUpdate = true;
        cloud.video.requestVideoFrameCallback(renew);
      };
      cloud.video.addEventListener('canplay', () => { cloud.startStream(); renew(); }, { once: true });
    }
    scene.add(new ROS3D.SceneNode({ frameID: asked.get('optical'), tfClient, object: cloud }));
    return cloud;
  },
};
const shown = {};
for (const name of (asked.get('show') ?? '').split(',')) shown[name] = show[name]();

// Where a point of the fixed frame is on the page, in pixels.
function pixel(px, py, pz) {
  const point = viewer.camera.position.clone().set(px, py, pz).project(viewer.camera);
  return [(point.x + 1) / 2 * 500, (1 - point.y) / 2 * 400];
}

// Every mesh of three.js below an object that can be seen now.
function visible(object) {
  const found = [];
  object.traverseVisible((each) => { if (each.geometry) found.push(each.name || each.type); });
  return found;
}
