;;; colony-mode.el --- files of the Colony language, with `colony lsp`  -*- lexical-binding: t -*-
(define-derived-mode colony-mode prog-mode "Colony"
  (setq-local comment-start "# " comment-start-skip "#+ *" indent-tabs-mode nil tab-width 2 fill-column 110)
  (modify-syntax-entry ?# "<") (modify-syntax-entry ?\n ">") (modify-syntax-entry ?_ "_")
  (setq-local font-lock-defaults
              '(((
                 "\\_<\\(?:robot\\|sensor\\|actuator\\|module\\|network\\|contract\\|assume\\|test\\|let\\|param\\|when\\|do\\)\\_>"
                 . font-lock-keyword-face)))))
(add-to-list 'auto-mode-alist '("\\.colony\\'" . colony-mode))
(with-eval-after-load 'eglot (add-to-list 'eglot-server-programs '(colony-mode "colony" "lsp")))
(provide 'colony-mode)
