"""The requests about one document, each with the type of its parameters and the feature that answers it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from colony.editing.features import completion, hover, margin, navigation, signature, symbols, tokens
from colony.editing.server.documents import EditedFile
from colony.editing.server.protocol import DocumentParams, PositionParams, RangeParams, Settings


def _quick_fixes(file: EditedFile, params: RangeParams) -> list[Any]:
    return margin.quick_fixes(file, params.range, [*file.file.findings, *file.proved_now])


Feature = tuple[type[Any], Callable[[Settings, EditedFile, Any], Any]]

FEATURES: dict[str, Feature] = {
    "textDocument/hover": (PositionParams, lambda _, f, p: hover.hover(f, p.position)),
    "textDocument/definition": (PositionParams, lambda _, f, p: navigation.definition(f, p.position)),
    "textDocument/documentHighlight": (PositionParams, lambda _, f, p: navigation.highlights(f, p.position)),
    "textDocument/completion": (PositionParams, lambda _, f, p: completion.completions(f, p.position)),
    "textDocument/signatureHelp": (PositionParams, lambda _, f, p: signature.signature_help(f, p.position)),
    "textDocument/documentSymbol": (DocumentParams, lambda _, f, p: symbols.document_symbols(f)),
    "textDocument/semanticTokens/full": (DocumentParams, lambda _, f, p: tokens.semantic_tokens(f)),
    "textDocument/foldingRange": (DocumentParams, lambda _, f, p: tokens.folds(f)),
    "textDocument/codeLens": (DocumentParams, lambda s, f, p: f.lenses(proves=s.prove)),
    "textDocument/codeAction": (RangeParams, lambda _, f, p: _quick_fixes(f, p)),
    "textDocument/inlayHint": (
        RangeParams,
        lambda s, f, p: margin.inlay_hints(f, p.range) if s.hints else [],
    ),
}
"""By method, the type of its parameters and its function of the settings, a document and parameters."""

COMMANDS = (margin.SHOW_RUN, margin.WRITE_TEST, margin.RUN_TEST)
"""The commands that an editor may ask for; each takes the URI of a document, and a name."""

WATCHING: dict[str, Any] = {
    "registrations": [
        {
            "id": "files",
            "method": "workspace/didChangeWatchedFiles",
            "registerOptions": {
                "watchers": [
                    {"globPattern": f"**/{name}"} for name in ("*.colony", "colony.toml", "pyproject.toml")
                ]
            },
        }
    ]
}
"""The wish to hear of the files on which findings depend."""

CAPABILITIES: dict[str, Any] = {
    "positionEncoding": "utf-16",
    "textDocumentSync": {"openClose": True, "change": 2, "save": True},
    **dict.fromkeys(
        (
            *("hoverProvider", "definitionProvider", "documentHighlightProvider", "referencesProvider"),
            *("renameProvider", "documentSymbolProvider", "workspaceSymbolProvider", "foldingRangeProvider"),
            *("documentFormattingProvider", "inlayHintProvider"),
        ),
        True,
    ),
    "completionProvider": {"triggerCharacters": [".", "(", '"']},
    "signatureHelpProvider": {"triggerCharacters": ["(", ","]},
    "codeActionProvider": {"codeActionKinds": ["quickfix"]},
    "codeLensProvider": {},
    "executeCommandProvider": {"commands": list(COMMANDS)},
    "semanticTokensProvider": {
        "legend": {"tokenTypes": list(tokens.TOKEN_TYPES), "tokenModifiers": []},
        "full": True,
    },
}
"""Capabilities of the server, the answer to `initialize`."""
