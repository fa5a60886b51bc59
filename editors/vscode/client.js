// Starts `colony lsp` for files of the Colony language, and stops it with the editor.
const path = require("path");
const vscode = require("vscode");
const { LanguageClient } = require("vscode-languageclient/node");

let client;

function command() {
  const [program, ...args] = vscode.workspace.getConfiguration("colony").get("command");
  const folder = vscode.workspace.workspaceFolders?.[0]?.uri.fsPath;
  const isRelative = /[\\/]/.test(program) && !path.isAbsolute(program);
  return { command: isRelative && folder ? path.join(folder, program) : program, args };
}

// The run that breaks a contract comes back as a text; it opens beside the file.
async function showResult(name, args, next) {
  const result = await next(name, args);
  if (result?.text !== undefined) {
    const document = await vscode.workspace.openTextDocument({ content: result.text });
    await vscode.window.showTextDocument(document, { preview: true, viewColumn: vscode.ViewColumn.Beside });
  }
  return result;
}

async function start() {
  const server = command();
  client = new LanguageClient("colony", "Colony", { run: server, debug: server }, {
    documentSelector: [{ language: "colony" }],
    middleware: { executeCommand: showResult },
  });
  try {
    await client.start();
  } catch (problem) {
    const hint = "Install it with `pip install colony`, or set `colony.command`.";
    vscode.window.showErrorMessage(`Colony: cannot start \`${server.command}\`: ${problem.message}. ${hint}`);
  }
}

exports.activate = async (context) => {
  context.subscriptions.push(
    vscode.workspace.onDidChangeConfiguration(async (change) => {
      if (change.affectsConfiguration("colony.command")) {
        await exports.deactivate();
        await start();
      }
    }),
  );
  await start();
};

exports.deactivate = async () => {
  const stopped = client;
  client = undefined;
  await stopped?.stop().catch(() => {});
};
