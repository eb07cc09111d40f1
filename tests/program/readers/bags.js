// Reads a bag with what is not kincal's, or writes one: node bags.js read FILE; node bags.js write FILE.mcap lz4|zstd.
// `read` prints, as JSON, each message's topic, type, time (ns, as text) and what it says.
"use strict";
const fs = require("fs");
const {Bag} = require("@foxglove/rosbag");
const {FileReader} = require("@foxglove/rosbag/node");
const {parse} = require("@foxglove/rosmsg");
const {MessageReader, MessageWriter} = require("@foxglove/rosmsg2-serialization");
const zstd = require("@foxglove/wasm-zstd");
const lz4 = require("lz4js");
const {McapIndexedReader, McapWriter} = require("@mcap/core");

const ns = (t) => (BigInt(t.sec) * 1000000000n + BigInt(t.nsec ?? t.nanosec)).toString();

/** What is compared of a message. */
function gist(m) {
  const out = {};
  if (m.header) out.stamp = ns(m.header.stamp), out.frame = m.header.frame_id;
  for (const key of ["name", "position", "width", "height", "encoding", "step", "K", "k", "D", "d", "distortion_model"])
    if (key in m) out[key.toLowerCase()] = typeof m[key] === "object" ? Array.from(m[key]) : m[key];
  if (m.data) out.data = typeof m.data === "string" ? m.data : [m.data.length, m.data.reduce((a, b) => (a * 31 + b) % 1000003, 0)];
  return out;
}

async function readRos1(path) {
  const bag = new Bag(new FileReader(path)), out = [];
  await bag.open();
  for await (const m of bag.messageIterator({}))
    out.push([m.topic, bag.connections.get(m.connectionId).type, ns(m.timestamp), gist(m.message)]);
  return out;
}

class McapFile {
  constructor(path) { this.fd = fs.openSync(path, "r"); }
  async size() { return BigInt(fs.fstatSync(this.fd).size); }
  async read(offset, length) {
    const out = new Uint8Array(Number(length));
    fs.readSync(this.fd, out, 0, out.length, Number(offset));
    return out;
  }
}

async function readMcap(path) {
  const reader = await McapIndexedReader.Initialize({readable: new McapFile(path)}), out = [], readers = new Map();
  for await (const m of reader.readMessages()) {
    const channel = reader.channelsById.get(m.channelId), schema = reader.schemasById.get(channel.schemaId);
    if (!readers.has(channel.id))
      readers.set(channel.id, new MessageReader(parse(new TextDecoder().decode(schema.data), {ros2: true})));
    out.push([channel.topic, schema.name, m.logTime.toString(), gist(readers.get(channel.id).readMessage(m.data))]);
  }
  if (Number(reader.statistics.messageCount) !== out.length) throw new Error("statistics count other messages");
  return out;
}

const DEFINITION = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + "=".repeat(80) +
  "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n" + "=".repeat(80) + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";

async function writeMcap(path, how) {
  await zstd.isLoaded;
  const fd = fs.openSync(path, "w");
  let size = 0n;
  const writable = {position: () => size, write: async (bytes) => { fs.writeSync(fd, bytes); size += BigInt(bytes.length); }};
  const compressChunk = (data) => ({compression: how, compressedData: how === "zstd" ? zstd.compress(data, 3) : Uint8Array.from(lz4.compress(data))});
  const writer = new McapWriter({writable, compressChunk, chunkSize: 4000});
  await writer.start({profile: "ros2", library: "a test"});
  const schemaId = await writer.registerSchema({name: "sensor_msgs/msg/JointState", encoding: "ros2msg", data: new TextEncoder().encode(DEFINITION)});
  const channelId = await writer.registerChannel({schemaId, topic: "/joint_states", messageEncoding: "cdr", metadata: new Map()});
  const cdr = new MessageWriter(parse(DEFINITION, {ros2: true}));
  for (let i = 0; i < 200; ++i) {
    const time = 1700000000n * 1000000000n + BigInt(i) * 10000000n;
    const data = cdr.writeMessage({header: {stamp: {sec: 1700000000, nanosec: i * 10000000}, frame_id: ""}, name: ["a", "bc"], position: [i, -i / 3], velocity: [], effort: []});
    await writer.addMessage({channelId, sequence: i, logTime: time, publishTime: time, data});
  }
  await writer.end();
}

const [what, path, how] = process.argv.slice(2);
const work = what === "write" ? writeMcap(path, how) : (path.endsWith(".mcap") ? readMcap : readRos1)(path).then((out) => console.log(JSON.stringify(out)));
work.catch((error) => { console.error(error); process.exit(1); });
