/** Script that a worker loads with its first compressed cloud. */

import { decompressCloud } from "./cloud_planes";

self.decompressCloud = decompressCloud;
