-- ~/.config/nvim/plugin/colony.lua: files of the Colony language, with `colony lsp`.
vim.api.nvim_create_autocmd({ "BufRead", "BufNewFile" }, { pattern = "*.colony", command = "setfiletype colony" })
vim.api.nvim_create_autocmd("FileType", {
  pattern = "colony",
  callback = function(event)
    vim.bo.commentstring, vim.bo.shiftwidth, vim.bo.expandtab = "# %s", 2, true
    local project = vim.fn.findfile("colony.toml", vim.fn.expand("%:p:h") .. ";")
    local root = project ~= "" and vim.fn.fnamemodify(project, ":p:h") or vim.fn.getcwd()
    local server = { name = "colony", cmd = { "colony", "lsp" }, root_dir = root }
    if vim.lsp.start then vim.lsp.start(server) -- before Neovim 0.8 each file has a server of its own
    else vim.lsp.buf_attach_client(event.buf, vim.lsp.start_client(server)) end
  end,
})
