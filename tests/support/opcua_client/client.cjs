// A client of OPC 10031-4 that calls what lines on stdin say, with node-opcua: node client.cjs ENDPOINT FOLDER URI USER TOKEN
//
// FOLDER has certificate.pem and key.pem, of the application URI. It connects with Basic256Sha256, signed and encrypted.
// A line is JSON: [object, method, arguments], where an argument is a text, a list of texts (LocalizedText[]), or
// {type, value}: a structure of the specification, a list of them if `value` is one. Each line is answered by a line of
// JSON: {result: [outputs]}, or {error}. All names and types come from the server's address space.
"use strict";
console.log = console.error; // stdout is for answers
const readline = require("node:readline");
const path = require("node:path");
const opcua = require("node-opcua-client");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");

const TYPES = "http://opcfoundation.org/UA/ISA95-JOBCONTROL_V2/";
const CELL = "urn:skiros2:cell:";
const [endpoint, folder, applicationUri, userName, password] = process.argv.slice(2);

const say = (answer) => process.stdout.write(`${JSON.stringify(answer)}\n`);

// Returns plain data: UInt64 as a number, variants and structures as their values.
function plain(value) {
  return JSON.parse(JSON.stringify(value, (key, each) => (each instanceof opcua.Variant ? plain(each.value) : each)));
}

async function main() {
  const client = opcua.OPCUAClient.create({
    applicationUri,
    certificateFile: path.join(folder, "certificate.pem"),
    privateKeyFile: path.join(folder, "key.pem"),
    clientCertificateManager: new OPCUACertificateManager({
      rootFolder: path.join(folder, "pki"),
      automaticallyAcceptUnknownCertificate: true,
    }),
    connectionStrategy: { maxRetry: 0 },
    endpointMustExist: false,
    securityMode: opcua.MessageSecurityMode.SignAndEncrypt,
    securityPolicy: opcua.SecurityPolicy.Basic256Sha256,
  });
  await client.connect(endpoint);
  const session = await client.createSession({ type: opcua.UserTokenType.UserName, userName, password });
  const namespaces = await session.readNamespaceArray();
  const types = namespaces.indexOf(TYPES);
  const cell = namespaces.findIndex((uri) => uri.startsWith(CELL));

  async function find(start, steps) {
    const result = await session.translateBrowsePath(opcua.makeBrowsePath(start, steps));
    if (!result.targets?.length) throw new Error(`${steps}: ${result.statusCode}`);
    return result.targets[0].targetId;
  }

  const structures = new Map();
  const found = await session.browse({
    nodeId: opcua.resolveNodeId("Structure"),
    referenceTypeId: "HasSubtype",
    includeSubtypes: true,
    browseDirection: opcua.BrowseDirection.Forward,
    resultMask: 63,
  });
  for (const each of found.references) {
    if (each.nodeId.namespace === types) structures.set(each.browseName.name, each.nodeId);
  }

  // Makes structures within structures: {type, value} anywhere in the data; {variant} is a variant of a JSON value.
  async function make(data) {
    if (Array.isArray(data)) return Promise.all(data.map(make));
    if (data === null || typeof data !== "object") return data;
    if ("variant" in data) {
      const dataType = { string: "String", number: "Double", boolean: "Boolean" }[typeof data.variant];
      return new opcua.Variant({ dataType, value: data.variant });
    }
    if (!("type" in data)) return data;
    const fields = {};
    for (const [key, value] of Object.entries(data.value)) fields[key] = await make(value);
    return session.constructExtensionObject(structures.get(data.type), fields);
  }

  async function argument(data) {
    const isArray = Array.isArray(data) || Array.isArray(data?.value);
    const arrayType = isArray ? opcua.VariantArrayType.Array : opcua.VariantArrayType.Scalar;
    if (typeof data === "string") return { dataType: opcua.DataType.String, value: data };
    if (Array.isArray(data)) {
      return { dataType: opcua.DataType.LocalizedText, arrayType, value: data.map(opcua.coerceLocalizedText) };
    }
    const value = isArray
      ? await Promise.all(data.value.map((each) => make({ type: data.type, value: each })))
      : await make(data);
    return { dataType: opcua.DataType.ExtensionObject, arrayType, value };
  }

  async function call([object, method, values]) {
    const objectId = await find("ObjectsFolder", `/${cell}:${object}`);
    const methodId = await find(objectId, `/${types}:${method}`);
    const inputArguments = await Promise.all(values.map(argument));
    const result = await session.call({ objectId, methodId, inputArguments });
    if (!result.statusCode.isGood()) return { error: result.statusCode.name };
    const outputs = result.outputArguments.map((output) =>
      output.dataType === opcua.DataType.UInt64 ? output.value[0] * 2 ** 32 + output.value[1] : plain(output.value),
    );
    return { result: outputs };
  }

  for await (const line of readline.createInterface({ input: process.stdin })) {
    const answer = await call(JSON.parse(line)).catch((error) => ({ error: String(error.message) }));
    say(answer);
  }
  await session.close();
  await client.disconnect();
}

main().catch((error) => {
  say({ error: String(error.message) });
  process.exit(1);
});
